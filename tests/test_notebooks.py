"""Notebooks run from top to bottom, and were committed as they ran: whole, small, and without a trace of where."""

from __future__ import annotations

import json
import re
from pathlib import Path

import pytest

NOTEBOOKS = sorted((Path(__file__).parent.parent / "notebooks").glob("*.ipynb"))
MOST_BYTES = 600_000
# The first thing a newcomer runs; the others take from half a minute to several.
QUICK = "quick_start"
FAST = "GLIDER_JAX_NOTEBOOK_FAST"


def read(path: Path) -> dict:
    """The notebook as plain data."""
    return json.loads(path.read_text(encoding="utf-8"))


def joined(text: str | list[str]) -> str:
    """A notebook keeps text as one string or as lines."""
    return text if isinstance(text, str) else "".join(text)


def code_cells(notebook: dict) -> list[dict]:
    """The cells that run."""
    return [cell for cell in notebook["cells"] if cell["cell_type"] == "code"]


def words(notebook: dict) -> str:
    """Everything that can be read in a notebook: sources, printed text and results, no pictures."""
    parts = [joined(cell["source"]) for cell in notebook["cells"]]
    for output in (output for cell in code_cells(notebook) for output in cell["outputs"]):
        parts.append(joined(output.get("text", "")))
        parts += [joined(v) for kind, v in output.get("data", {}).items() if kind.startswith("text/")]
    return "\n".join(parts)


def errors(notebook: dict) -> list[str]:
    """Exceptions and what was written to standard error, by the number of the cell."""
    found = []
    for cell in code_cells(notebook):
        for output in cell["outputs"]:
            if output["output_type"] == "error":
                found.append(f"[{cell['execution_count']}] {output['ename']}: {output['evalue']}")
            elif output.get("name") == "stderr":
                found.append(f"[{cell['execution_count']}] {joined(output['text'])[:300]}")
    return found


@pytest.fixture(params=NOTEBOOKS, ids=lambda path: path.name)
def path(request) -> Path:
    """Each notebook in turn."""
    return request.param


def test_there_are_notebooks():
    assert QUICK in {path.stem for path in NOTEBOOKS}


def test_was_run_from_top_to_bottom(path):
    notebook = read(path)
    counts = [cell["execution_count"] for cell in code_cells(notebook)]
    assert counts == list(range(1, len(counts) + 1)), "run all cells of a fresh kernel, then save"
    assert errors(notebook) == []
    assert any("image/png" in o.get("data", {}) for cell in code_cells(notebook) for o in cell["outputs"])


def test_is_small(path):
    assert path.stat().st_size < MOST_BYTES


def test_names_no_place_of_the_machine_it_ran_on(path):
    text = words(read(path))
    roots = r"(?:home|root|tmp|work|opt|usr|var|mnt|private|Users)/"
    assert re.findall(rf"(?<![\w./:])/{roots}\S*|\b[A-Z]:\\\S*", text) == []
    assert re.findall(r"\.\./shared|\bTODO\b|\bFIXME\b|\bXXX\b|0x[0-9a-f]{6,}", text) == []


def test_uses_what_is_public(path):
    code = "\n".join(joined(cell["source"]) for cell in code_cells(read(path)))
    assert re.findall(r"^\s*(?:from|import)\s.*[\s.,]_[a-z]\w*", code, re.MULTILINE) == []
    assert re.findall(r"\w\._(?!replace\b)[a-z]\w*", code) == [], "a named tuple's _replace is public"
    assert re.findall(r"https?://|^\s*[!%]", code, re.MULTILINE) == [], "no network, no shell"


def marked(path: Path):
    """A notebook as a parameter; all but the quick start must be asked for."""
    return pytest.param(path, id=path.name, marks=() if path.stem == QUICK else pytest.mark.slow)


# Jupyter's own warnings are not ours.
@pytest.mark.filterwarnings("default")
@pytest.mark.parametrize("which", [marked(path) for path in NOTEBOOKS])
def test_runs(which, tmp_path, monkeypatch):
    needs = "the extra 'notebook' is not installed"
    nbformat = pytest.importorskip("nbformat", reason=needs)
    client = pytest.importorskip("nbclient", reason=needs)
    pytest.importorskip("ipykernel", reason=needs)
    monkeypatch.setenv(FAST, "1")
    # The kernel draws into the notebook; a backend chosen for the tests would leave the pictures out.
    monkeypatch.delenv("MPLBACKEND", raising=False)
    notebook = nbformat.read(which, as_version=4)
    for cell in notebook.cells:
        if cell.cell_type == "code":
            cell.outputs = []
    resources = {"metadata": {"path": str(tmp_path)}}
    client.NotebookClient(notebook, timeout=1200, kernel_name="python3", resources=resources).execute()
    assert errors(notebook) == []
