"""`python -m vibroimpact` and the console script are the program."""

from __future__ import annotations

import json
import shutil
import signal
import subprocess
import sys
import sysconfig
import time
from pathlib import Path

import pytest

from conftest import AT_ONCE, call, interruptible

PYTHON = [sys.executable, "-m", "vibroimpact"]


@pytest.mark.parametrize(
    "arguments",
    [
        ["--help"],
        ["--version"],
        ["scenes"],
        ["scenes", "displaced"],
        ["plan", "default"],
        ["plan", "default", "--set", "oscillator.h=-1"],
        ["run", "none.toml"],
        ["validate"],
        ["--nonsense"],
    ],
    ids=" ".join,
)
def test_the_program_in_the_wheel_answers_as_the_one_in_rust(arguments: list[str], program: list[str]) -> None:
    ours, theirs = call(*PYTHON, *arguments), call(*program, *arguments)
    assert (ours.returncode, ours.stdout, ours.stderr) == (theirs.returncode, theirs.stdout, theirs.stderr)


def test_the_console_script_runs_a_scene(tmp_path: Path) -> None:
    script = shutil.which("vibroimpact", path=sysconfig.get_path("scripts"))
    assert script
    out = tmp_path / "out"
    it = call(script, "run", "stationary", "--set", "oscillator.h=1e-3", "--threads", "1", "--out", str(out))
    assert it.returncode == 0 and "P(loss)" in it.stdout and f"files: {out}" in it.stdout
    assert json.loads((out / "results.json").read_text(encoding="utf-8"))["scene"]["oscillator"]["h"] == 1e-3
    # A folder that exists is refused.
    assert call(script, "run", "stationary", "--out", str(out)).returncode == 2


@pytest.mark.skipif(sys.platform == "win32", reason="a signal to one process alone")
def test_an_interrupt_ends_the_program(tmp_path: Path) -> None:
    line = ["run", "default", "--set", "monte_carlo.paths=1e9", "--quiet", "--out", str(tmp_path / "out")]
    process = subprocess.Popen([*PYTHON, *line], preexec_fn=interruptible)
    while not (tmp_path / "out" / "results.json").exists():
        time.sleep(0.02)
        assert process.poll() is None
    process.send_signal(signal.SIGINT)
    clock = time.perf_counter()
    assert process.wait(300) == -signal.SIGINT
    assert time.perf_counter() - clock < AT_ONCE
    json.loads((tmp_path / "out" / "results.json").read_text(encoding="utf-8"))
