"""Maps: the same numbers by threads, processes and a cluster that loses a worker."""

from __future__ import annotations

import multiprocessing
import os
import signal
import subprocess
import sys
import threading
import time
from concurrent.futures import ProcessPoolExecutor, ThreadPoolExecutor
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import vibroimpact as vi
from conftest import AT_ONCE, DENSITY, QUICK, call, interruptible

MOMENTS = {**DENSITY, "outputs": {"stationary": True, "moments_at": [1, 2]}}

OVER = {"oscillator.h": [1e-3, 2e-3, 3e-3], "oscillator.zeta": np.array([0.005, 0.01])}


def same(a: vi.Map, b: vi.Map) -> bool:
    axes = a.axes.keys() == b.axes.keys() and all(np.array_equal(a.axes[key], b.axes[key]) for key in a.axes)
    return axes and list(a) == list(b) and all(a[name] == b[name] for name in a) and a.failed == b.failed


def test_a_point_of_a_map_is_its_scene_alone() -> None:
    m = vi.map(QUICK, OVER)
    assert m.shape == (3, 2) and list(m.axes) == list(OVER) and not m.failed and not m.missed
    for i, h in enumerate(m.axes["oscillator.h"]):
        for k, zeta in enumerate(m.axes["oscillator.zeta"]):
            scene = vi.Scene(QUICK).replace("oscillator.h", h).replace("oscillator.zeta", zeta)
            alone = vi.run(scene)["stationary"]
            for name in ("mean_q", "contact_loss_probability", "loss_rate"):
                found = m[f"stationary.{name}"]
                assert found[i, k] == alone[name]
        assert str(found) == "3 x 2 numbers"
    with pytest.raises(IndexError):
        found[0]
    with pytest.raises(KeyError, match="stationary.mean_q"):
        m["mean_q"]


def test_a_map_holds_what_the_program_collects(program: list[str], tmp_path: Path) -> None:
    scene = vi.Scene(MOMENTS)
    (tmp_path / "scene.toml").write_text(scene.to_toml())
    out = str(tmp_path / "map")
    over = ["--over", "oscillator.h=lin:1e-2:3e-2:3", "--over", "oscillator.zeta=[0.05, 0.1]"]
    assert call(*program, "map", str(tmp_path / "scene.toml"), *over, "--quiet", "--out", out).returncode == 0
    assert call(*program, "collect", out).returncode == 0
    theirs = np.load(Path(out) / "map.npz")
    m = vi.map(scene, {"oscillator.h": "lin:1e-2:3e-2:3", "oscillator.zeta": [0.05, 0.1]})
    assert np.array_equal(m.axes["oscillator.h"], theirs["oscillator.h"])
    compared = 0
    for name in m:
        if name in theirs:
            assert np.array_equal(m[name].value, theirs[name], equal_nan=True), name
            compared += 1
    assert compared > 20 and m["transient.mean_q"].value.shape == (3, 2, 2)
    assert all(name in m or name.endswith("_error") or name in m.axes for name in theirs), list(theirs)


def test_every_executor_gives_the_same_numbers() -> None:
    here = vi.map(MOMENTS, {"oscillator.h": [1e-2, 2e-2]}, threads=1)
    assert same(here, vi.map(MOMENTS, {"oscillator.h": [1e-2, 2e-2]}, threads=3))
    with ThreadPoolExecutor(2) as pool:
        assert same(here, vi.map(MOMENTS, {"oscillator.h": [1e-2, 2e-2]}, pool))
    for method in multiprocessing.get_all_start_methods():
        with ProcessPoolExecutor(2, mp_context=multiprocessing.get_context(method)) as processes:
            assert same(here, vi.map(MOMENTS, {"oscillator.h": [1e-2, 2e-2]}, processes, threads=2)), method


def test_curves_are_kept_where_they_are_asked_for() -> None:
    scene = {**QUICK, "outputs": {"crossings": {"window": 20}}}
    over = {"oscillator.h": [1e-3, 2e-3]}
    assert "crossings.flight_density" not in vi.map(scene, over)
    kept = vi.map(scene, over, keep=["crossings"])
    density, time_ = kept["crossings.flight_density"], kept["crossings.flight_time"]
    assert density.value.shape == time_.value.shape and density.value.shape[0] == 2
    with pytest.raises(vi.SceneError):
        vi.map(scene, over, keep=["nonsense"])


@pytest.mark.parametrize(
    ("over", "key"),
    [
        ({}, "over"),
        ({"oscillator.h": [1e-3, -1]}, "oscillator.h"),
        ({"oscillator.hh": [1]}, "oscillator.hh"),
        ({"oscillator.h": 1e-3}, "oscillator.h"),
        ({"oscillator.h": []}, None),
        ({"oscillator.h": "log:0:1:3"}, None),
    ],
)
def test_a_map_that_is_wrong_is_refused_before_anything_runs(over: Any, key: str | None) -> None:
    with pytest.raises(vi.SceneError) as raised:
        vi.map(QUICK, over)
    assert key is None or raised.value.key == key, raised.value
    with pytest.raises(vi.SceneError):
        vi.map(QUICK, OVER, executor="threads")  # type: ignore[arg-type]


def test_a_point_that_fails_does_not_stop_the_others() -> None:
    scene = {**DENSITY, "outputs": {"moments_at": [1]}}
    with pytest.warns(UserWarning, match="1 points failed"):
        m = vi.map(scene, {"accuracy.max_memory": [1000, 8_000_000_000]})
    assert list(m.failed) == [(0,)] and "max_memory" in m.failed[0,]
    value = m["transient.mean_q"].value
    assert np.isnan(value[0]).all() and np.isfinite(value[1]).all()


def test_progress_and_an_interrupt(tmp_path: Path) -> None:
    heard: list[tuple[str, float]] = []
    vi.map(QUICK, {"oscillator.h": np.linspace(1e-3, 2e-3, 50)}, progress=lambda *it: heard.append(it))
    assert heard[-1] == ("map", 1.0)
    if sys.platform == "win32":
        return
    code = (
        "import vibroimpact as vi, numpy as np\n"
        "scene = {'oscillator': {'zeta': 0.005, 'h': 1e-3}, 'outputs': {'moments_at': [1]}, 'monte_carlo': {'paths': 10**7}}\n"
        "told = lambda *it: print('begun', flush=True)\n"
        "try:\n    vi.map(scene, {'oscillator.h': np.linspace(1e-3, 2e-3, 20)}, progress=told)\n"
        "except KeyboardInterrupt:\n    print('interrupted', flush=True)\n    import os; os._exit(0)\n"
    )
    process = subprocess.Popen(
        [sys.executable, "-c", code], stdout=subprocess.PIPE, text=True, preexec_fn=interruptible
    )
    assert process.stdout is not None and process.stdout.readline() == "begun\n"
    process.send_signal(signal.SIGINT)
    clock = time.perf_counter()
    while (line := process.stdout.readline()) == "begun\n":
        pass
    assert line == "interrupted\n" and time.perf_counter() - clock < AT_ONCE
    process.wait(30)


def test_a_cluster_that_loses_a_worker_completes_the_map() -> None:
    distributed = pytest.importorskip("distributed", reason="pip install distributed")
    scene = {**MOMENTS, "monte_carlo": {"paths": 20_000}}
    over = {"oscillator.h": np.linspace(1e-2, 2e-2, 12).tolist()}
    here = vi.map(scene, over)
    with distributed.LocalCluster(
        n_workers=2, threads_per_worker=1, processes=True, dashboard_address=None
    ) as cluster, distributed.Client(cluster) as client:
        victims = client.run(os.getpid)
        killed = threading.Event()

        def told(stage: str, fraction: float) -> None:
            if fraction > 0.2 and not killed.is_set():
                killed.set()
                os.kill(next(iter(victims.values())), signal.SIGTERM if sys.platform == "win32" else signal.SIGKILL)

        there = vi.map(scene, over, client, progress=told)
    assert killed.is_set() and same(here, there)


def test_an_axis_of_lists_of_other_lengths_has_them_as_its_values() -> None:
    lists = [[0.5], [0.5, 1.0]]
    m = vi.map({**DENSITY, "outputs": {"moments_at": [1]}}, {"outputs.moments_at": lists})
    assert list(m.axes["outputs.moments_at"]) == lists and m.shape == (2,)
    found = m["transient.mean_q"].value
    # Each within its tolerance.
    assert found.shape == (2, 2) and abs(found[0, 0] - found[1, 0]) < 1e-3 and np.isnan(found[0, 1])
