"""Results: the program's numbers to the last bit, as arrays; numbers with errors; files; pickles; pictures."""

from __future__ import annotations

import io
import json
import math
import pickle
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import vibroimpact as vi
from conftest import DENSITY, QUICK, call

# Seconds each; the rest of the built-in scenes take minutes in all.
SCENES = ["stationary", "bilinear", "dropped", "free-fall", "overdamped", "rare-loss", "first-loss", "default"]


def numbers(tree: dict[str, Any]) -> str:
    """results.json without what a clock says, as text: equal to the last bit."""
    tree = {**tree, "run": {key: tree["run"][key] for key in ("version", "warnings")}}
    return json.dumps(tree, sort_keys=False)


@pytest.mark.parametrize("name", SCENES)
def test_the_numbers_are_those_of_the_program_to_the_last_bit(name: str, program: list[str], tmp_path: Path) -> None:
    out = tmp_path / "program"
    status = call(*program, "run", name, "--threads", "2", "--quiet", "--out", str(out)).returncode
    r = vi.run(vi.scene(name), threads=1)
    assert status == (0 if r.reached_tolerance else 3)
    assert numbers(json.loads((out / "results.json").read_text(encoding="utf-8"))) == numbers(r.to_dict())
    mine = tmp_path / "python"
    r.save(mine)
    assert sorted(it.name for it in mine.iterdir()) == sorted(it.name for it in out.iterdir())
    for path in out.iterdir():
        if path.suffix in (".csv", ".npz", ".svg", ".toml"):
            assert path.read_bytes() == (mine / path.name).read_bytes(), path.name
    assert r.to_dict()["run"]["threads"] == 1


def test_a_run_into_a_folder_leaves_what_save_writes(tmp_path: Path, computed: vi.Results) -> None:
    r = vi.run(DENSITY, out=tmp_path / "run")
    assert r == computed
    r.save(tmp_path / "save")
    run, save = ({it.name: it.read_bytes() for it in (tmp_path / name).iterdir()} for name in ("run", "save"))
    assert run == save
    assert json.loads(run["results.json"]) == r.to_dict()


def test_a_folder_that_exists_is_refused_unless_forced(tmp_path: Path) -> None:
    (tmp_path / "note.txt").write_text("mine")
    r = vi.run(QUICK)
    for write in (lambda: r.save(tmp_path), lambda: vi.run(QUICK, out=tmp_path)):
        with pytest.raises(vi.SceneError, match="force=True") as raised:
            write()
        assert raised.value.key == "out"
        assert [it.name for it in tmp_path.iterdir()] == ["note.txt"]
    r.save(tmp_path, force=True)
    assert (tmp_path / "note.txt").read_text() == "mine" and (tmp_path / "report.html").is_file()
    with pytest.raises(vi.VibroimpactError):
        r.save(tmp_path / "note.txt" / "below")


def test_sections_are_numbers_curves_and_arrays(computed: vi.Results) -> None:
    r = computed
    loss = r["stationary"]["contact_loss_probability"]
    assert isinstance(loss, vi.Number) and 0 < float(loss) < 1
    assert loss.error < 1e-9
    t, mean = r["transient"]["t"], r["transient"]["mean_q"]
    assert isinstance(t, np.ndarray) and t.tolist() == [1, 2, 5]
    assert mean.value.dtype == mean.error.dtype == np.float64 and mean.value.shape == t.shape == (len(mean),)
    assert mean[1] == vi.Number(float(mean.value[1]), float(mean.error[1])) == list(mean)[1]
    assert np.array_equal(np.asarray(mean), mean.value) and len(mean[1:]) == 2
    assert r["decay_rates"][0]["re"] < 0
    assert list(r) == list(r.to_dict()) and "spectrum" not in r and r.get("spectrum") is None
    with pytest.raises(KeyError, match="spectrum.*not asked for"):
        r["spectrum"]
    assert r.warnings == r.to_dict()["run"]["warnings"]
    assert str(r).startswith("vibroimpact ") and "transient" in repr(r)


def test_what_does_not_exist_is_none_or_nan() -> None:
    r = vi.run(vi.scene("free-fall"))
    entropy = r["transient"]["relative_entropy"]
    assert np.isnan(entropy.value).all() and np.isnan(entropy.error).all()
    linear = vi.run({"oscillator": {"contact": "linear", "zeta": 0.1, "h": 1e-3}})
    assert linear["stationary"]["loss_rate"] is None


def test_a_density_is_an_array_that_looks_into_the_results(computed: vi.Results) -> None:
    r = computed
    assert r.times == (2.0, 5.0, math.inf)
    d = r.density(5)
    assert d.p.shape == (d.q.size, d.v.size) and d.p.flags.c_contiguous and d.p.dtype == np.float64
    assert not d.p.flags.owndata and not d.p.flags.writeable and not d.q.flags.writeable
    assert d.p.ctypes.data == r.density(5.0).p.ctypes.data
    with pytest.raises(ValueError):
        d.p[0, 0] = 1
    saved = np.load(io.BytesIO(r.files()["density_5.npz"]))
    assert np.array_equal(saved["p"], d.p) and np.array_equal(saved["q"], d.q) and np.array_equal(saved["v"], d.v)
    mass = (d.p * np.gradient(d.q)[:, None] * np.gradient(d.v)).sum()
    assert abs(mass - 1) < 1e-3
    with pytest.raises(vi.SceneError, match="one of 2, 5, inf"):
        r.density(3)
    with pytest.raises(vi.SceneError):
        r.density()
    alone = vi.run({**DENSITY, "outputs": {"density_at": [1]}})
    kept = alone.density()
    total = kept.p.sum()
    # The arrays hold the results that they look into.
    del alone
    assert kept.p.sum() == total and kept.t == 1


def test_results_survive_a_pickle_whole(computed: vi.Results, tmp_path: Path) -> None:
    r = computed
    again = pickle.loads(pickle.dumps(pickle.loads(pickle.dumps(r))))
    assert again == r and again.to_dict() == r.to_dict() and again.scene == r.scene
    assert str(again) == str(r) and again._repr_html_() == r._repr_html_() and again.files() == r.files()
    for t in r.times:
        a, b = again.density(t), r.density(t)
        assert np.array_equal(a.p, b.p) and np.array_equal(a.q, b.q) and not a.p.flags.writeable
    again.save(tmp_path / "again")
    assert (tmp_path / "again" / "density_2.npz").read_bytes() == r.files()["density_2.npz"]
    d = pickle.loads(pickle.dumps(r.density(2)))
    assert np.array_equal(d.p, r.density(2).p)
    again.to_dict()["transient"].clear()
    assert again == r


@pytest.mark.parametrize(
    ("number", "text"),
    [
        (vi.Number(0.07245565, 1.2e-5), "0.072456 +- 1e-05"),
        (vi.Number(0.0724556513458, 1e-13), "0.07245565134580 +- 1e-13"),
        (vi.Number(3.5123e-14, 2e-16), "3.512e-14 +- 2e-16"),
        (vi.Number(1234.5678, 0.5), "1234.57 +- 5e-01"),
        (vi.Number(-0.1, 2.0), "0 +- 2e+00"),
        (vi.Number(0.0, 0.0), "0.0 +- 0"),
        (vi.Number(1e300, 1e290), "1.00000000000e+300 +- 1e+290"),
    ],
)
def test_a_number_prints_to_the_digit_after_the_first_of_its_error(number: vi.Number, text: str) -> None:
    assert str(number) == text or text == "0 +- 2e+00" and str(number) == "-0.1 +- 2e+00"
    hidden = 0.0 < number.error < 5e-4
    error = f"{number.error:.0e}" if hidden else f"{number.error:.3f}"
    assert "+-" in f"{number}" and f"{number:.3f}" == f"{number.value:.3f} +- {error}"


def test_numbers_become_those_of_uncertainties(computed: vi.Results) -> None:
    pytest.importorskip("uncertainties")
    loss = computed["stationary"]["loss_rate"].to_ufloat()
    assert (loss * 2).std_dev == 2 * loss.std_dev > 0
    curve = computed["transient"]["mean_q"]
    assert [it.nominal_value for it in curve.to_ufloat()] == curve.value.tolist()


def test_a_notebook_shows_table_and_pictures(computed: vi.Results) -> None:
    html = computed._repr_html_()
    assert html.count("<svg") == html.count("</svg>") > 2 and "<table" in html and "<html" not in html
    assert set(computed.files()) >= {"moments.svg", "snapshots.svg", "report.html", "results.json"}


def test_pictures_by_matplotlib(computed: vi.Results) -> None:
    matplotlib = pytest.importorskip("matplotlib")
    matplotlib.use("Agg")
    figure = computed.plot()
    titles = [ax.get_title() for ax in figure.axes]
    assert {"t = 2", "t = 5", "stationary", "transient"} <= set(titles)
    ax = computed.density(5).plot()
    shown = ax.collections[0].get_array()
    assert np.array_equal(np.asarray(shown).reshape(-1), computed.density(5).p.T.reshape(-1))
    assert vi.run(QUICK).plot().axes[0].get_title() == "stationary"


def test_a_tolerance_not_reached_is_warned_of() -> None:
    scene = vi.Scene({**QUICK, "outputs": {"decay_rates": 2}, "accuracy": {"tolerance": 1e-13, "max_seconds": 30}})
    with pytest.warns(vi.ToleranceWarning, match="decay_rates: the tolerance 1e-13 is not met"):
        r = vi.run(scene)
    assert not r.reached_tolerance


def test_a_limit_before_the_first_answer_is_an_error_that_names_its_key() -> None:
    scene = vi.Scene(DENSITY).replace("accuracy.max_seconds", 1e-4).replace("outputs.moments_at", [500])
    with pytest.raises(vi.LimitError) as raised:
        vi.run(scene)
    assert raised.value.key == "accuracy.max_seconds" and not isinstance(raised.value, ValueError)
