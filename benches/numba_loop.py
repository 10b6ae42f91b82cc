"""The loop of a Monte Carlo in numba: BAOAB under the Hertz force, one path after another, one core.

    pip install numba && python3 benches/numba_loop.py

prints nanoseconds per path and step, the best of several runs, to stand beside "Monte Carlo step, baoab" of
benches/summary.rs on the same machine: 35 ns in numba 0.68 where that takes about 3.
"""

import math
import time

import numba
import numpy as np

ZETA, H, STEP, STEPS, PATHS = 0.005, 2e-3, 0.05, 200, 8192


@numba.njit(fastmath=True)
def force(q):
    u = max(0.0, 1.0 + q * (2.0 / 3.0))
    return u * math.sqrt(u) - 1.0


@numba.njit(fastmath=True)
def baoab(q, v, steps, step, zeta, temperature, seed):
    np.random.seed(seed)
    decay = math.exp(-2.0 * zeta * step)
    spread = math.sqrt(temperature * (1.0 - decay * decay))
    for i in range(q.size):
        x, y = q[i], v[i]
        n = force(x)
        for _ in range(steps):
            y -= 0.5 * step * n
            x += 0.5 * step * y
            y = decay * y + spread * np.random.standard_normal()
            x += 0.5 * step * y
            n = force(x)
            y -= 0.5 * step * n
        q[i], v[i] = x, y


temperature = math.pi * H / (2.0 * ZETA)
best = math.inf
for k in range(10):
    start = np.random.default_rng(k)
    q, v = 0.9 * start.standard_normal(PATHS), 0.8 * start.standard_normal(PATHS)
    clock = time.process_time()
    # The first run compiles; it is never the best.
    baoab(q, v, STEPS, STEP, ZETA, temperature, k)
    best = min(best, time.process_time() - clock)
print(f"numba {numba.__version__}: {1e9 * best / (PATHS * STEPS):.1f} ns per path and step")
print(f"E[v^2] {np.mean(v * v):.3f} of {temperature:.3f}")
