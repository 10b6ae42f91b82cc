"""What the pages and the notebooks show runs, and its types hold."""

from __future__ import annotations

import os
import re
import subprocess
import sys
from pathlib import Path

import pytest

from conftest import ROOT

PYTHON = Path(__file__).resolve().parents[1]
NOTEBOOKS = sorted((PYTHON / "notebooks").glob("*.py"))
PAGES = [ROOT / "README.md", PYTHON / "README.md", ROOT / "docs" / "python.md", ROOT / "docs" / "results.md"]

# What a page takes for granted: a finished run of the reader's own.
PREPARED = """
import vibroimpact as vi
from pathlib import Path
scene = vi.Scene({"oscillator": {"zeta": 0.05, "h": 2e-2}, "initial": {"mean": [1, 0], "deviation": [0.4, 0.4]},
                  "outputs": {"stationary": True, "moments_at": [5, 20], "density_at": [20]}})
vi.run(scene, out="results/mine")
Path("my.toml").write_text(scene.to_toml())
del scene, vi, Path
"""


def snippets(page: Path) -> list[str]:
    return re.findall(r"^```python\n(.*?)^```", page.read_text(encoding="utf-8"), re.MULTILINE | re.DOTALL)


def run(code: str, folder: Path) -> str:
    # A script, so that its processes can be spawned from it.
    script = folder / "script.py"
    script.write_text(code, encoding="utf-8")
    environment = {**os.environ, "MPLBACKEND": "Agg"}
    environment = {**environment, "PYTHONIOENCODING": "utf-8"}
    it = subprocess.run([sys.executable, script], cwd=folder, env=environment, capture_output=True, encoding="utf-8")
    assert it.returncode == 0, it.stdout + it.stderr
    return it.stdout


@pytest.mark.parametrize("page", PAGES, ids=lambda it: str(it.relative_to(ROOT)))
def test_the_python_of_a_page_runs(page: Path, tmp_path: Path) -> None:
    found = snippets(page)
    assert found, f"{page} shows no Python"
    run(PREPARED + "\n".join(found), tmp_path)


def test_five_lines_give_the_density_as_an_array_and_a_picture(tmp_path: Path) -> None:
    pytest.importorskip("matplotlib")
    first = snippets(PYTHON / "README.md")[0]
    lines = [line for line in first.splitlines() if line.strip() and not line.startswith("#")]
    assert len(lines) <= 5, first
    shown = 'assert p.ndim == 2 and abs((p * 1.0).sum()) > 0\nfrom pathlib import Path\nassert Path("density.png").stat().st_size > 5000'
    run(f"{first}\n{shown}", tmp_path)


@pytest.mark.parametrize("notebook", NOTEBOOKS, ids=lambda it: it.stem)
def test_a_notebook_runs_and_its_claims_hold(notebook: Path, tmp_path: Path) -> None:
    text = notebook.read_text(encoding="utf-8")
    assert text.count("\n# %%") > 5 and "assert" in text
    print(run(text, tmp_path))


def test_a_notebook_of_each_kind_is_there() -> None:
    assert {it.stem for it in NOTEBOOKS} >= {"first_steps", "table_4", "map_h_zeta"}


def test_the_types_are_those_that_mypy_finds(tmp_path: Path) -> None:
    pytest.importorskip("mypy")
    code = "\n".join(snippets(PYTHON / "README.md"))
    (tmp_path / "readme.py").write_text(code, encoding="utf-8")
    files = [*NOTEBOOKS, tmp_path / "readme.py", tmp_path / "wrong.py"]
    (tmp_path / "wrong.py").write_text("import vibroimpact as vi\nx: int = vi.run(vi.scene(1))\n")
    command = [sys.executable, "-m", "mypy", "--strict", "--cache-dir", str(tmp_path / "cache")]
    it = subprocess.run([*command, *files], cwd=tmp_path, capture_output=True, text=True)
    # Of what is right nothing is said, and what is wrong is seen: the package has types.
    lines = [line for line in it.stdout.splitlines() if "error:" in line]
    assert len(lines) == 2 and all("wrong.py:2" in line for line in lines), it.stdout
    it = subprocess.run([*command, "-p", "vibroimpact"], cwd=tmp_path, capture_output=True, text=True)
    assert it.returncode == 0, it.stdout
