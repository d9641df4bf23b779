"""The public face: what is documented, what is imported, and what comes with the package."""

import ast
import subprocess
import sys
from pathlib import Path

import pytest

import flutterviz
import solver

FOLDERS = [Path(str(package.__file__)).parent for package in (solver, flutterviz)]
SOURCES = [path for folder in FOLDERS for path in sorted(folder.rglob("*.py"))]
# Words that make a number of a physical field: a doc line with neither one of these nor a unit says too little.
NUMBERS = {"float", "Floats"}


def _public(node: ast.ClassDef | ast.FunctionDef) -> bool:
    return not node.name.startswith("_")


@pytest.mark.parametrize("path", SOURCES, ids=lambda p: f"{p.parent.name}/{p.name}")
def test_file_says_what_it_owns(path: Path) -> None:
    text = ast.get_docstring(ast.parse(path.read_text(encoding="utf-8")))
    assert text, "a module's docstring says what the file owns"


@pytest.mark.parametrize("path", SOURCES, ids=lambda p: f"{p.parent.name}/{p.name}")
def test_number_fields_of_public_classes_have_a_unit(path: Path) -> None:
    """A field that holds numbers is followed by a docstring with a unit in brackets, as [m] or [-]."""
    missing = []
    for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
        if not (isinstance(node, ast.ClassDef) and _public(node)):
            continue
        for field, after in zip(node.body, [*node.body[1:], ast.Pass()], strict=True):
            if not (isinstance(field, ast.AnnAssign) and isinstance(field.target, ast.Name)):
                continue
            kind = set(ast.unparse(field.annotation).replace("|", " ").replace("[", " ").replace("]", " ").split())
            told = isinstance(after, ast.Expr) and isinstance(after.value, ast.Constant) and str(after.value.value)
            named = not field.target.id.startswith("_")
            if named and not told and ast.unparse(field.annotation) not in HELPED:
                missing.append(f"{node.name}.{field.target.id}: no docstring")
            elif named and kind & NUMBERS and "[" not in str(told) and field.target.id not in UNITLESS:
                missing.append(f"{node.name}.{field.target.id}: no unit")
    assert not missing


HELPED = {"DesignName", "JsonFlag", "RrdFile"}  # command-line types that carry their help with them
UNITLESS = {"cosine", "sine", "rate", "actual", "linear"}  # ratios that need no bracket, and matrices of two units


def test_solver_needs_no_viewer() -> None:
    """In a process of its own: this one has imported everything already."""
    code = "import sys, solver; print([m for m in ('viser', 'rerun', 'matplotlib', 'rich') if m in sys.modules])"
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert done.stdout.strip() == "[]"


def test_every_public_name_is_there() -> None:
    assert [name for name in solver.__all__ if not hasattr(solver, name)] == []


def test_presets_load_and_are_those_promised() -> None:
    assert {"seed-840", "seed-1200", "seed-bare"} <= set(solver.preset_names())
    six = {i * 6 + j for i in (3, 4, 5) for j in (2, 3)}
    ten = {i * 6 + j for i in range(2, 7) for j in (2, 3)}
    wanted = {"seed-bare": (840.0, set()), "seed-840": (840.0, six), "seed-1200": (1200.0, ten)}
    for name, (pressure, elements) in wanted.items():
        design = solver.load_design(name)
        assert design.flow.dynamic_pressure == pressure
        assert design.flow.damping == 0.01
        assert set(design.patches.elements) == elements
