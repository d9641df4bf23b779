"""Command lines run in this process, and what they print."""

import json
from typing import Any

import pytest

from flutterviz.cli import run

BARE = ["seed-bare", "--reduction.modes", "6"]
COARSE = ["--mesh.nx", "8", "--mesh.ny", "4"]


def answer(capsys: pytest.CaptureFixture[str], *words: str) -> dict[str, Any]:
    """The JSON object that a command prints, alone on stdout."""
    code = run([*words, "--json"])
    out, err = capsys.readouterr()
    assert code == 0, err
    assert out.count("\n") == 1
    value = json.loads(out)
    assert isinstance(value, dict)
    return value


def complaint(capsys: pytest.CaptureFixture[str], *words: str, begun: bool = False) -> str:
    """The one line on stderr with which a command refuses what it was given; after its progress, if it has begun."""
    code = run(list(words))
    out, err = capsys.readouterr()
    assert code == 2, err
    assert out == ""
    assert "Traceback" not in err
    assert err.endswith("\n")
    progress, _, line = err[:-1].rpartition("\n")
    assert begun or progress == ""
    assert line.startswith("flutterviz: ")
    return line
