"""What the Python package costs: `python python/tests/measure.py [PROGRAM]`, with the package installed.

Prints wall time, and CPU time, which tells more on a machine that computes other things too."""

from __future__ import annotations

import json
import os
import subprocess
import sys
import tempfile
import time
from pathlib import Path

import vibroimpact as vi

PROGRAM = sys.argv[1] if len(sys.argv) > 1 else str(Path(__file__).parents[2] / "target" / "release" / "vibroimpact")


def program(name: str) -> float:
    """Seconds that the program says its stages took."""
    with tempfile.TemporaryDirectory() as folder:
        out = os.path.join(folder, "out")
        subprocess.run([PROGRAM, "run", name, "--quiet", "--out", out], check=True)
        tree = json.loads(Path(out, "results.json").read_text(encoding="utf-8"))
    return float(tree["run"]["wall_seconds"])


def package(name: str) -> float:
    """Seconds from the call to the numbers."""
    scene = vi.scene(name)
    clock = time.perf_counter()
    vi.run(scene).to_dict()
    return time.perf_counter() - clock


for name, times in [("stationary", 20), ("bilinear", 10), ("dropped", 10), ("default", 5)]:
    # In turns, so that both meet the same neighbours.
    pairs = [(program(name), package(name)) for _ in range(times)]
    theirs, ours = min(a for a, _ in pairs), min(b for _, b in pairs)
    print(f"{name:<11} program {1e3 * theirs:8.1f} ms, vi.run {1e3 * ours:8.1f} ms, best of {times}")

clock, cpu = time.perf_counter(), time.process_time()
for k in range(10_000):
    vi.run({"oscillator": {"zeta": 0.005, "h": 1e-3 + 1e-7 * k}})["stationary"]["contact_loss_probability"]
wall, used = time.perf_counter() - clock, time.process_time() - cpu
print(f"1e4 closed-form scenes: {wall:.2f} s, {used:.2f} s of CPU")
