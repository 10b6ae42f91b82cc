"""What several tests use."""

from __future__ import annotations

import os
import shutil
import signal
import subprocess
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[2]

# Seconds within which what is stopped has ended: one on a machine of its own, and every run would take many times this.
AT_ONCE = 20.0

QUICK = {"oscillator": {"zeta": 0.005, "h": 2e-3}}

DENSITY = {
    "oscillator": {"zeta": 0.05, "h": 2e-2},
    "initial": {"mean": [1.0, 0.0], "deviation": [0.4, 0.4]},
    "outputs": {"stationary": True, "moments_at": [1, 2, 5], "density_at": [2, 5], "steady": True, "decay_rates": 2},
}


def interruptible() -> None:
    """Before a process begins: a shell's background jobs, and what they begin, ignore interrupts."""
    signal.signal(signal.SIGINT, signal.SIG_DFL)


@pytest.fixture(scope="session")
def program() -> list[str]:
    """The program built by cargo: VIBROIMPACT_PROGRAM, or the one in target/release."""
    name = "vibroimpact.exe" if sys.platform == "win32" else "vibroimpact"
    built = os.environ.get("VIBROIMPACT_PROGRAM", str(ROOT / "target" / "release" / name))
    if not shutil.which(built):
        pytest.fail(f"{built} is not there: cargo build --release, or python/test.sh")
    return [built]


@pytest.fixture(scope="session")
def computed() -> object:
    import vibroimpact as vi

    return vi.run(DENSITY)


def call(*command: str, **options: object) -> subprocess.CompletedProcess[str]:
    return subprocess.run(command, capture_output=True, text=True, encoding="utf-8", **options)  # type: ignore[call-overload,no-any-return]
