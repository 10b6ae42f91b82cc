"""Threads, processes, signals, progress."""

from __future__ import annotations

import json
import multiprocessing
import os
import signal
import subprocess
import sys
import threading
import time
from concurrent.futures import ProcessPoolExecutor, ThreadPoolExecutor
from pathlib import Path

import pytest

import vibroimpact as vi
from conftest import AT_ONCE, DENSITY, QUICK, interruptible

LONG = {
    "oscillator": {"zeta": 0.005, "h": 2e-3},
    "outputs": {"stationary": True, "moments_at": [50]},
    "monte_carlo": {"paths": 10**9},
    "accuracy": {"max_seconds": 3600},
}


class Stop(Exception):
    pass


def test_python_goes_on_while_a_run_computes() -> None:
    stop, began = threading.Event(), threading.Event()

    def told(stage: str, fraction: float) -> None:
        began.set()
        if stop.is_set():
            raise Stop

    with ThreadPoolExecutor(1) as pool:
        long = pool.submit(vi.run, LONG, threads=1, progress=told)
        assert began.wait(30)
        # Other runs come to their ends meanwhile, on other threads too.
        for _ in range(3):
            assert vi.run(QUICK, threads=1)["stationary"]["mean_q"].value < 0
        assert not long.done()
        stop.set()
        assert isinstance(long.exception(timeout=300), Stop)


def test_two_threads_run_two_scenes_in_parallel() -> None:
    scene = vi.Scene({**QUICK, "outputs": {"moments_at": [50]}, "monte_carlo": {"paths": 100_000}})
    together, lock, most = [0], threading.Lock(), [0]
    spans: list[tuple[float, float]] = []

    def one(_: int) -> vi.Results:
        with lock:
            together[0] += 1
            most[0] = max(most[0], together[0])
        begin = time.perf_counter()
        r = vi.run(scene, threads=1)
        with lock:
            together[0] -= 1
            spans.append((begin, time.perf_counter()))
        return r

    cpu, clock = time.process_time(), time.perf_counter()
    with ThreadPoolExecutor(2) as pool:
        a, b = pool.map(one, range(2))
    busy = (time.process_time() - cpu) / (time.perf_counter() - clock)
    print(f"{busy:.2f} cores busy")
    overlap = min(end for _, end in spans) - max(begin for begin, _ in spans)
    assert a == b and most[0] == 2
    assert overlap > 0.5 * min(end - begin for begin, end in spans)
    # One run at a time keeps one core busy at most. Where others compute too, two may get no more.
    if (os.cpu_count() or 1) > 1 and hasattr(os, "getloadavg") and os.getloadavg()[0] < 0.5:
        assert busy > 1.3


def test_threads_and_nothing_else_decide_the_threads() -> None:
    code = "import vibroimpact as vi\nfor n in (None, 1, 3):\n print(vi.run({'oscillator': {'zeta': 0.1, 'h': 1e-3}}, threads=n)['run']['threads'])"
    told = subprocess.run(
        [sys.executable, "-c", code],
        env={**os.environ, "RAYON_NUM_THREADS": "7"},
        capture_output=True,
        text=True,
        check=True,
    ).stdout.split()
    cores = len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count()
    assert told == [str(cores), "1", "3"]
    assert vi.run(DENSITY, threads=1) == vi.run(DENSITY, threads=3)


def test_progress_is_told_stage_by_stage() -> None:
    heard: list[tuple[str, float]] = []
    vi.run(DENSITY, progress=lambda *it: heard.append(it))
    names = list(dict.fromkeys(name for name, _ in heard))
    assert names == ["stationary", "transient", "steady", "decay_rates"]
    for name in names:
        fractions = [fraction for it, fraction in heard if it == name]
        assert fractions == sorted(fractions) and fractions[-1] == 1.0


def test_progress_is_a_bar_or_a_line(capfd: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch) -> None:
    pytest.importorskip("tqdm")
    vi.run(DENSITY, progress=True)
    out, err = capfd.readouterr()
    assert not out and "transient: 100%" in err
    monkeypatch.setitem(sys.modules, "tqdm.auto", None)
    vi.run(DENSITY, progress=True)
    out, err = capfd.readouterr()
    assert not out and [it.split("\r")[-1] for it in err.splitlines()][-1] == "decay_rates      100 %"
    vi.run(DENSITY)
    assert capfd.readouterr() == ("", "")


def test_what_the_progress_function_raises_ends_the_run() -> None:
    def told(stage: str, fraction: float) -> None:
        raise Stop(stage)

    clock = time.perf_counter()
    with pytest.raises(Stop):
        vi.run(LONG, progress=told)
    assert time.perf_counter() - clock < AT_ONCE


def work(h: float) -> tuple[vi.Results, int]:
    return vi.run(vi.Scene(DENSITY).replace("oscillator.h", h), threads=2), os.getpid()


@pytest.mark.parametrize("method", multiprocessing.get_all_start_methods())
def test_processes_of_every_kind_run_scenes(method: str) -> None:
    # The parent has threads of its own already.
    here, own = work(2e-2)
    with ProcessPoolExecutor(2, mp_context=multiprocessing.get_context(method)) as pool:
        there = list(pool.map(work, [1e-2, 2e-2], timeout=300))
    assert there[1][0] == here and there[0][0] != here
    assert own not in (pid for _, pid in there)
    assert there[1][0].density(5).p.sum() == here.density(5).p.sum()


INTERRUPTED = """
import sys, time
import vibroimpact as vi

scene = vi.Scene.from_toml(sys.argv[1])
told = lambda stage, fraction: stage == sys.argv[3] and print("begun", flush=True)
try:
    vi.run(scene, progress=told, out=sys.argv[2])
except KeyboardInterrupt:
    print("interrupted", flush=True)
    # The process is as good as before.
    vi.run({"oscillator": {"zeta": 0.1, "h": 1e-3}})
    print("well", flush=True)
"""

# What takes long, stage by stage; nothing stops the factorisation of the last half way.
HERTZ = "[oscillator]\nzeta = 0.005\nh = 2e-3\n"
ENDLESS = {
    "monte_carlo": HERTZ + "[outputs]\nstationary = true\nmoments_at = [1]\n[monte_carlo]\npaths = 10000000000\n",
    "transient": HERTZ + "[outputs]\nstationary = true\nmoments_at = [1e5]\n[method]\ncells = [400, 300]\nstep = 0.1\n",
    "decay_rates": "[oscillator]\nzeta = 0.005\nh = 1e-6\n[outputs]\nstationary = true\ndecay_rates = 100\n[accuracy]\ntolerance = 1e-12\n",
    "first_loss": "[oscillator]\nzeta = 0.005\nh = 3.2e-3\n[outputs]\nstationary = true\nfirst_loss = { until = 200 }\n[accuracy]\ntolerance = 1e-5\n",
    "spectrum": HERTZ + "[outputs]\nstationary = true\nspectrum = { until = 4.0 }\n[accuracy]\ntolerance = 1e-9\n",
    "steady": HERTZ + "[outputs]\nstationary = true\nsteady = true\n[method]\ndrift = 8\ncells = [300, 240]\n",
}


@pytest.mark.skipif(sys.platform == "win32", reason="a signal to one process alone")
@pytest.mark.parametrize("stage", ENDLESS)
def test_an_interrupt_ends_a_run_at_once_and_leaves_whole_files(stage: str, tmp_path: Path) -> None:
    scene, out = tmp_path / "scene.toml", tmp_path / "out"
    scene.write_text(ENDLESS[stage])
    process = subprocess.Popen(
        [sys.executable, "-c", INTERRUPTED, str(scene), str(out), stage],
        stdout=subprocess.PIPE,
        text=True,
        preexec_fn=interruptible,
    )
    assert process.stdout is not None
    assert process.stdout.readline() == "begun\n"
    time.sleep(0.3)
    clock = time.perf_counter()
    process.send_signal(signal.SIGINT)
    line = process.stdout.readline()
    while line == "begun\n":
        line = process.stdout.readline()
    seconds = time.perf_counter() - clock
    print(f"{stage}: {seconds:.3f} s")
    assert line == "interrupted\n" and seconds < AT_ONCE
    left = {it.name for it in out.iterdir()}
    assert not any(name.endswith(".part") for name in left), left
    assert {"results.json", "scene.toml", "stationary.csv"} <= left
    tree = json.loads((out / "results.json").read_text(encoding="utf-8"))
    # It had not ended, or ended early with what it had found so far.
    said = (f"unfinished: {stage} had not ended", f"stopped: the {stage} stage ")
    warnings = tree["run"]["warnings"]
    assert "stationary" in tree and any(it.startswith(said) for it in warnings), warnings
    assert process.stdout.readline() == "well\n"
    assert process.wait(60) == 0
