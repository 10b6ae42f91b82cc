"""Scenes: from dicts, text and files; what is wrong with them; plans."""

from __future__ import annotations

import copy
import pickle
from pathlib import Path

import numpy as np
import pytest

import vibroimpact as vi
from conftest import DENSITY, QUICK, call


def test_every_built_in_scene_is_itself_as_text_as_dict_and_pickled() -> None:
    names = vi.scenes()
    assert names[0] == "default" and len(names) > 10
    for name in names:
        scene = vi.scene(name)
        assert scene == vi.Scene.from_toml(scene.to_toml()), name
        assert scene == vi.Scene(scene.to_dict()), name
        assert scene == pickle.loads(pickle.dumps(scene)) == copy.deepcopy(scene), name
        assert hash(scene) == hash(vi.Scene(scene.to_dict()))
        assert scene != scene.replace("oscillator.zeta", 0.123)
        assert name in repr(scene) and "[oscillator]" in scene._repr_html_()


def test_a_scene_comes_from_a_file_by_its_path(tmp_path: Path) -> None:
    path = tmp_path / "mine.toml"
    path.write_text("[oscillator]\nzeta = 0.005\nh = 2e-3\n")
    assert vi.Scene.from_toml(path) == vi.Scene.from_toml(str(path))
    # A file without a title is named after itself.
    assert vi.Scene.from_toml(path).to_dict()["title"] == "mine"
    with pytest.raises(FileNotFoundError):
        vi.Scene.from_toml(tmp_path / "none.toml")
    path.write_bytes(b"title = '\xff'")
    with pytest.raises(vi.SceneError, match="UTF-8"):
        vi.Scene.from_toml(path)


def test_plain_values_are_those_of_python_and_numpy() -> None:
    plain = {**QUICK, "outputs": {"moments_at": [0.5, 1.0, 1.5]}, "monte_carlo": {"seed": 2**64 - 1, "paths": 100}}
    numpy = {
        "oscillator": {"zeta": np.float64(0.005), "h": np.float64(2e-3), "contact": None},
        "outputs": {"moments_at": np.linspace(0.5, 1.5, 3, dtype=np.float32)},
        "monte_carlo": {"seed": np.uint64(2**64 - 1), "paths": np.int32(100)},
    }
    scene = vi.Scene(plain)
    assert scene == vi.Scene(numpy)
    assert scene.to_dict()["monte_carlo"]["seed"] == 2**64 - 1
    tuples = scene.replace("outputs.moments_at", (0.5, 1.0, 1.5)).replace("outputs.stationary", False)
    assert tuples == scene
    odd = vi.Scene({**QUICK, "title": 'a "b" \\ \x7f'.replace("\x7f", "é")})
    assert odd.to_dict()["title"] == 'a "b" \\ é'


def test_a_key_replaced_is_the_key_written() -> None:
    scene = vi.scene("displaced")
    assert scene.replace("oscillator.h", 1e-3).to_dict()["oscillator"]["h"] == 1e-3
    assert scene.to_dict()["oscillator"]["h"] == 2e-3
    changed = scene.replace("oscillator.contact", "bilinear").replace("oscillator.h", np.float64(5e-3))
    expected = {"contact": "bilinear", "damping": "viscous", "zeta": 0.005, "h": 5e-3}
    assert changed.to_dict()["oscillator"] == expected
    every = scene.replace("outputs.moments_at", {"every": 0.5, "until": 5})
    assert every.to_dict()["outputs"]["moments_at"] == {"every": 0.5, "until": 5.0}


def test_a_function_that_is_no_law_is_told_in_a_few_lines() -> None:
    with pytest.raises(vi.SceneError) as raised:
        vi.Scene({"oscillator": {"zeta": 0.005, "h": 2e-3, "contact": lambda q: -q}})
    error = raised.value
    assert error.key == "oscillator.contact" and "601 points" in str(error.accepted)
    assert len(str(error)) < 600


@pytest.mark.parametrize(
    ("make", "key", "value", "accepted"),
    [
        (lambda: vi.Scene({"oscillator": {"zeta": -1, "h": 1e-3}}), "oscillator.zeta", "-1", "> 0"),
        (lambda: vi.Scene({"oscillator": {"zeta": 0.1, "h": float("nan")}}), "oscillator.h", "NaN", "finite"),
        (lambda: vi.Scene({"oscillator": {"zeta": 0.1, "hh": 1}}), "oscillator.hh", "1", "force_psd"),
        (lambda: vi.Scene({"oscilator": {"zeta": 0.1}}), "oscilator", "a table", "oscillator"),
        (lambda: vi.Scene({"oscillator": {"zeta": 0.1}}), "oscillator.h", None, "input level"),
        (lambda: vi.Scene({}), "oscillator", None, "zeta"),
        (lambda: vi.Scene({**QUICK, "outputs": {"steady": 1}}), "outputs.steady", "1", "true or false"),
        (lambda: vi.Scene({**QUICK, "outputs": {"moments_at": [2, 1]}}), "outputs.moments_at[1]", "1.0", "ascending"),
        (lambda: vi.Scene({**QUICK, "outputs": {"moments_at": [1, None]}}), "outputs.moments_at[1]", "None", "value"),
        (lambda: vi.Scene({**QUICK, "title": object}), "title", "<class 'object'>", "text"),
        (lambda: vi.Scene({**QUICK, "title": b"x"}), "title", "b'x'", "text"),
        (lambda: vi.Scene.from_toml("[oscillator]\nzeta = 1\nh = 'x'"), "oscillator.h", '"x"', "a number"),
        (lambda: vi.scene("defalt"), "scene", "'defalt'", "default"),
        (lambda: vi.scene().replace("oscillator.contact", "hertzz"), "oscillator.contact", '"hertzz"', '"hertz"'),
        (lambda: vi.scene().replace("oscillator.contact", {"law": "power", "exponent": 0.5}), "oscillator.contact.exponent", "0.5", "1 to 100"),
        (lambda: vi.scene().replace("oscillator.h", None), "oscillator.h", "None", "to_dict"),
        (lambda: vi.scene("free-fall").replace("outputs.steady", True), "outputs.steady", "true", "stationary law"),
        (lambda: vi.plan(vi.scene().replace("method.cells", [10**6, 10**6])), "method.cells", "[1000000, 1000000]", "max_memory"),
        (lambda: vi.run(QUICK, threads=0), "threads", "0", "1 to 1024"),
        (lambda: vi.run(QUICK, threads=True), "threads", "True", "1 to 1024"),
        (lambda: vi.run(QUICK, progress="yes"), "progress", "'yes'", "True"),  # type: ignore[arg-type]
        (lambda: vi.run("default"), "scene", "'default'", "Scene"),  # type: ignore[arg-type]
    ],
)
def test_a_wrong_scene_tells_key_value_and_what_is_accepted(make, key, value, accepted) -> None:  # type: ignore[no-untyped-def]
    with pytest.raises(vi.VibroimpactError) as raised:
        make()
    error = raised.value
    assert isinstance(error, ValueError) and isinstance(error, vi.SceneError)
    assert (error.key, error.value) == (key, value)
    assert error.accepted and accepted in error.accepted, error.accepted
    assert error.key in str(error) or error.value is None
    again = pickle.loads(pickle.dumps(error))
    assert (type(again), str(again), again.key, again.value) == (vi.SceneError, str(error), key, value)


def test_a_contact_law_from_functions_is_its_table() -> None:
    oscillator = {"zeta": 0.05, "h": 2e-2}
    one = vi.Scene({"oscillator": {"contact": lambda q: q + 0.3 * q**3, **oscillator}})
    functions = (lambda q: q + 0.3 * q**3, lambda q: q * q / 2 + 0.075 * q**4, lambda q: 1 + 0.9 * q * q)
    assert vi.Scene({"oscillator": {"contact": functions, **oscillator}}) == one
    polynomial = {"law": "polynomial", "coefficients": [1.0, 0.0, 0.3]}
    exact = vi.run(vi.Scene({"oscillator": {"contact": polynomial, **oscillator}}))["stationary"]
    sampled = vi.run(one)["stationary"]
    for name in ("mean_q", "var_q", "kurtosis_force"):
        assert abs(sampled[name].value - exact[name].value) < 1e-6
    assert pickle.loads(pickle.dumps(one)) == one
    for wrong in (
        (functions[0], functions[0], functions[2]),
        (functions[0], 3, functions[2]),
        functions[:2],
        lambda q: 1 / q,
        lambda q: "one",
    ):
        with pytest.raises(vi.SceneError) as raised:
            vi.Scene({"oscillator": {"contact": wrong, **oscillator}})
        assert raised.value.key == "oscillator.contact"


def test_the_message_shows_the_line_of_the_scene() -> None:
    with pytest.raises(vi.SceneError) as raised:
        vi.Scene.from_toml("[oscillator]\nzeta = 0.005\nh = -2e-3\n")
    message = str(raised.value)
    assert message.startswith("oscillator.h = -0.002 is not accepted\n") and "3 │ h = -2e-3" in message
    with pytest.raises(vi.SceneError) as raised:
        vi.scene().replace("oscillator.h", -1)
    assert "oscillator.h = -1" in str(raised.value) and "--set" not in str(raised.value)


def test_a_law_that_does_not_confine_is_refused_by_its_key() -> None:
    with pytest.raises(vi.SceneError) as raised:
        vi.Scene({"oscillator": {"zeta": 0.1, "h": 1e-3, "contact": abs}})
    assert (raised.value.key or "").startswith("oscillator.contact")


def test_wrong_keys_of_damping_reach_and_drive_are_refused_by_name() -> None:
    for key, value in [
        ("oscillator.damping", "none"),
        ("outputs.reach", {"quantity": "mean_v", "fraction": 0.9}),
        ("excitation.drive", {"amplitude": 0.02}),
    ]:
        with pytest.raises(vi.SceneError) as raised:
            vi.plan(vi.scene().replace(key, value))
        assert (raised.value.key or "").startswith(key.split(".")[0]), raised.value.key


def test_a_plan_says_what_the_program_says(program: list[str]) -> None:
    for name in ("default", "spectrum"):
        plan = vi.plan(vi.scene(name))
        printed = call(*program, "plan", name).stdout
        assert str(plan) == printed
        assert {it.name for it in plan.stages} >= {"stationary"}
        assert plan.seconds == sum(it.seconds for it in plan.stages) > 0
        assert plan.memory_bytes == max(it.memory_bytes for it in plan.stages) > 0
    stage = next(it for it in vi.plan(DENSITY).stages if it.name == "transient")
    assert stage.needed_by == ("outputs.moments_at", "outputs.density_at")
    assert isinstance(stage.cells, tuple) and "flow map" in stage.method
    assert str(pickle.loads(pickle.dumps(plan))) == str(plan) and "spectrum" in repr(plan)


def test_a_plan_can_be_run() -> None:
    plan = vi.plan(QUICK)
    assert vi.run(plan) == vi.run(QUICK)
