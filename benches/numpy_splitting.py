"""A Strang splitting in NumPy, as one would write it by hand: the strongest rival found.

    pip install numpy && python3 benches/numpy_splitting.py

prints, for both cases of `cargo bench --bench flow_map -- case`, the L1 error of the density and the time on one
core, set-up included, the best of several runs. Case L is held against its closed form, case H against a fine run
of this same script (448 x 320, step 0.01; half a minute).

A step: half a step of q' = v, a shift of every column by Fourier's theorem; a whole step of
v' = -2 zeta v - G(q) + noise, exact for fixed q: a matrix in v, the same for every q, then a shift of every row;
half a step of q' = v. Second order in the step, spectral in q and v; the density is periodic in its truncated domain.
"""

import os

for name in ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS"):
    os.environ[name] = "1"

import math
import time

import numpy as np


def centres(low, high, n):
    return low + (high - low) * (np.arange(n) + 0.5) / n


def gaussian(q, v, mean, cov):
    x = np.stack(np.broadcast_arrays(q[:, None] - mean[0], v[None, :] - mean[1]))
    form = np.einsum("iab,ij,jab->ab", x, np.linalg.inv(cov), x)
    return np.exp(-0.5 * form) / (2.0 * math.pi * math.sqrt(np.linalg.det(cov)))


def friction(v, wave, decay, variance):
    """v -> decay v + noise: the density at v of the trigonometric interpolant on the nodes v."""
    weight = np.full(wave.size, 2.0)
    weight[0] = 1.0
    if v.size % 2 == 0:
        weight[-1] = 0.0
    weight *= np.exp(-0.5 * variance * wave**2) / v.size
    phase = np.multiply.outer(v, wave)[:, None, :] - decay * np.multiply.outer(v, wave)[None, :, :]
    return np.cos(phase) @ weight


def solve(case, domain, cells, step):
    """The density at the end of a case, with its nodes."""
    force, zeta, temperature, mean, deviation, end = case
    q, v = centres(*domain[0], cells[0]), centres(*domain[1], cells[1])
    wave_q = 2.0 * math.pi * np.fft.rfftfreq(q.size, q[1] - q[0])
    wave_v = 2.0 * math.pi * np.fft.rfftfreq(v.size, v[1] - v[0])
    steps = max(1, round(end / step))
    step = end / steps
    decay = math.exp(-2.0 * zeta * step)
    half = np.exp(-0.5j * step * np.multiply.outer(wave_q, v))
    whole = half * half
    kick = np.exp(1j * np.multiply.outer(force(q) * (1.0 - decay) / (2.0 * zeta), wave_v))
    to_v = np.ascontiguousarray(friction(v, wave_v, decay, temperature * (1.0 - decay**2)).T)
    p = gaussian(q, v, mean, np.diag([deviation**2, deviation**2]))
    p = np.fft.irfft(np.fft.rfft(p, axis=0) * half, q.size, axis=0)
    for k in range(steps):
        p = np.fft.irfft(np.fft.rfft(p @ to_v, axis=1) * kick, v.size, axis=1)
        shift = half if k + 1 == steps else whole
        p = np.fft.irfft(np.fft.rfft(p, axis=0) * shift, q.size, axis=0)
    return q, v, p


def at(q, v, fine):
    """A density known on fine nodes at other nodes, by its trigonometric interpolant."""

    def basis(x, nodes):
        n = nodes.size
        wave = 2.0 * math.pi * np.fft.fftfreq(n, nodes[1] - nodes[0])
        return np.exp(1j * np.multiply.outer(x - nodes[0], wave)) / n

    return (basis(q, fine[0]) @ np.fft.fft2(fine[2]) @ basis(v, fine[1]).T).real


def report(name, case, reference, domain, cells, step):
    best = math.inf
    for _ in range(15):
        clock = time.process_time()
        q, v, p = solve(case, domain, cells, step)
        best = min(best, time.process_time() - clock)
    error = np.abs(p - reference(q, v)).sum() * (q[1] - q[0]) * (v[1] - v[0])
    print(f"{name}  {cells[0]} x {cells[1]}, step {step}: L1 error {error:.1e} in {1e3 * best:.2f} ms", flush=True)


def hertz(q):
    return np.maximum(1.0 + 2.0 * q / 3.0, 0.0) ** 1.5 - 1.0


def linear_at_the_end(q, v):
    """The Gaussian of the linear oscillator: its motion and the covariance that noise adds."""
    zeta, t = LINEAR[1], LINEAR[5]
    w = math.sqrt(1.0 - zeta**2)
    c, s, e = math.cos(w * t), math.sin(w * t) / w, math.exp(-zeta * t)
    motion = e * np.array([[c + zeta * s, s], [-s, c - zeta * s]])
    stationary = LINEAR[2] * np.eye(2)
    cov = stationary + motion @ (LINEAR[4] ** 2 * np.eye(2) - stationary) @ motion.T
    return gaussian(q, v, motion @ LINEAR[3], cov)


# Force, zeta, T, mean and deviation at t = 0, end.
HERTZ = (hertz, 0.005, math.pi * 2e-3 / 0.01, (0.0, 0.0), 0.3, 50.0)
LINEAR = (lambda q: q, 0.05, 0.25, (1.0, 0.0), 0.2, 4.0 * math.pi)

if __name__ == "__main__":
    print(f"numpy {np.__version__}")
    for n, reach, step in ((24, 2.4, 0.2), (32, 2.6, 0.1), (40, 2.8, 0.023), (48, 3.0, 0.0102)):
        report("case L", LINEAR, linear_at_the_end, ((-reach, reach),) * 2, (n, n), step)
    fine = solve(HERTZ, ((-9.0, 5.0), (-5.0, 5.0)), (448, 320), 0.01)
    for cells, step in (((60, 48), 0.1), ((80, 56), 0.05), ((90, 64), 0.025)):
        report("case H", HERTZ, lambda q, v: at(q, v, fine), ((-7.0, 4.0), (-3.8, 3.8)), cells, step)
