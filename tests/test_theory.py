"""THEORY.md beside the code: every name that it gives exists, and no module or public function is left out."""

import importlib
import inspect
import re
from pathlib import Path

import pytest

import solver

FOLDER = Path(solver.__file__).parent
TEXT = (FOLDER / "THEORY.md").read_text(encoding="utf-8")
NAMES = sorted(set(re.findall(r"`solver((?:\.\w+)+)`", TEXT)))
MODULES = sorted(path.stem for path in FOLDER.glob("*.py") if path.stem != "__init__")
FUNCTIONS = [name for name in solver.__all__ if inspect.isfunction(getattr(solver, name))]


def there(module: str, *path: str) -> bool:
    """Whether a name can be reached from a module of the solver; a field without a default is an annotation alone."""
    # not by getattr on the package: there `solver.sweep` is the function, not its module
    found = importlib.import_module(f"solver.{module}")
    for name in path:
        if hasattr(found, name):
            found = getattr(found, name)
        elif name not in getattr(found, "__annotations__", {}):
            return False
    return True


@pytest.mark.parametrize("name", NAMES)
def test_every_name_exists(name: str) -> None:
    module, *path = name.strip(".").split(".")
    assert module in MODULES
    assert there(module, *path), f"solver{name} is in THEORY.md and not in the code"


@pytest.mark.parametrize("module", MODULES)
def test_every_module_is_named(module: str) -> None:
    assert any(name.split(".")[1] == module for name in NAMES), f"THEORY.md says nothing of solver.{module}"


@pytest.mark.parametrize("name", FUNCTIONS)
def test_every_public_function_is_named(name: str) -> None:
    whole = f".{getattr(solver, name).__module__.removeprefix('solver.')}.{name}"
    assert whole in NAMES, f"THEORY.md does not name solver{whole}"


def test_no_code_name_escapes_the_pattern() -> None:
    """A name with a call's brackets, or a space, would not be looked up at all."""
    assert not [code for code in re.findall(r"`(solver\.[^`]*)`", TEXT) if not re.fullmatch(r"solver(\.\w+)+", code)]
