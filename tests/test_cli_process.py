"""The command line as a process of its own: streams, exit codes, and the explorer served until a signal."""

import json
import os
import re
import signal
import subprocess
import sys
import urllib.request
from pathlib import Path

import pytest

from solver import Design, save_design

ENVIRONMENT = {**os.environ, "PYTHONPATH": str(Path(__file__).parents[1])}


def process(*words: str) -> "subprocess.CompletedProcess[str]":
    command = [sys.executable, "-m", "flutterviz", *words]
    return subprocess.run(command, capture_output=True, text=True, env=ENVIRONMENT, timeout=120)


def test_a_process_answers_on_stdout_and_exits_with_0(tmp_path: Path) -> None:
    path = tmp_path / "design.json"
    save_design(Design(), path)
    done = process("flutter", str(path), "--json")
    assert done.returncode == 0
    assert json.loads(done.stdout)["lambda_cr"] == pytest.approx(514.91, rel=5e-4)
    assert done.stderr == ""


@pytest.mark.parametrize("number", [signal.SIGTERM, signal.SIGINT])
def test_the_explorer_is_served_on_loopback_until_it_is_ended(number: int) -> None:
    command = [sys.executable, "-m", "flutterviz", "view", "--no-open", "--port", "0", "--reduction.modes", "6"]
    with subprocess.Popen(
        command, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True, env=ENVIRONMENT
    ) as server:
        try:
            assert server.stderr is not None
            said = next(found for line in server.stderr if (found := re.search(r"http://\S+", line)))
            assert said[0].startswith("http://127.0.0.1:")
            with urllib.request.urlopen(said[0], timeout=20) as answered:
                assert answered.status == 200
            server.send_signal(number)
            out, err = server.communicate(timeout=20)
        finally:
            server.kill()
    assert (server.returncode, out) == (0, "")
    assert "Traceback" not in err


def test_a_process_complains_on_stderr_and_exits_with_2() -> None:
    done = process("simulate", "seed-840", "--patches.elements", "999")
    assert (done.returncode, done.stdout) == (2, "")
    assert done.stderr.count("\n") == 1
    assert "999" in done.stderr
