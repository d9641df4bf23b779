"""Owns the name of the machine that figures were measured on: processor, libraries and how busy it was."""

from __future__ import annotations

import os
import platform
import subprocess
from dataclasses import dataclass
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path

import numpy as np

BUSY = 0.5  # of its cores at work for others, from which a machine's times mean little
THREADS = {  # what each library of linear algebra reads its number of threads from, the first that is set
    "openblas": ("OPENBLAS_NUM_THREADS", "OMP_NUM_THREADS"),
    "mkl": ("MKL_NUM_THREADS", "OMP_NUM_THREADS"),
    "accelerate": ("VECLIB_MAXIMUM_THREADS",),
}


@dataclass(frozen=True)
class Machine:
    """A machine and what runs on it."""

    cpu: str
    """Model of the processor."""
    cores: int
    """Cores that this process may use."""
    system: str
    """Operating system."""
    python: str
    """Version of Python."""
    numpy: str
    """Version of numpy."""
    blas: str
    """Linear algebra under numpy, with its version."""
    blas_threads: int | None
    """Threads it works on; None where that is its own choice."""
    scipy: str
    """Version of scipy."""
    numba: str
    """Version of numba."""
    viser: str
    """Version of viser."""
    load: float | None
    """Load average of the last minute when the measuring began [cores]; None where the system tells none."""

    @staticmethod
    def present() -> Machine:
        """This machine, now."""
        blas = _blas()
        return Machine(
            cpu=_cpu(),
            cores=_cores(),
            system=f"{platform.system()} {platform.release()}".strip() or "unknown",
            python=platform.python_version(),
            numpy=np.__version__,
            blas=blas,
            blas_threads=_blas_threads(blas),
            scipy=_version("scipy"),
            numba=_version("numba"),
            viser=_version("viser"),
            load=_load(),
        )

    @property
    def warnings(self) -> list[str]:
        """What to mind when reading its figures, a line each."""
        if self.load is None or self.load <= BUSY * self.cores:
            return []
        return [
            f"the machine is busy, load average {self.load:.1f} on {cores_in_words(self.cores)}: times come out longer "
            "than without that, ratios hardly change"
        ]

    def __str__(self) -> str:
        """Name it in a line."""
        load = "" if self.load is None else f"; load average {self.load:.1f}"
        return (
            f"{self.cpu}, {cores_in_words(self.cores)}, {self.system}; Python {self.python}, numpy {self.numpy} with "
            f"{self.blas} on {threads_in_words(self.blas_threads)}, scipy {self.scipy}, numba {self.numba}, "
            f"viser {self.viser}{load}"
        )


def cores_in_words(count: int) -> str:
    """As `2 cores`."""
    return f"{count} core{'' if count == 1 else 's'}"


def threads_in_words(count: int | None) -> str:
    """As `1 thread`."""
    return "as many threads as it likes" if count is None else f"{count} thread{'' if count == 1 else 's'}"


def _cpu() -> str:
    """The processor's model, or at least its family."""
    try:
        if platform.system() == "Linux":
            lines = Path("/proc/cpuinfo").read_text(encoding="utf-8", errors="replace").splitlines()
            fields = (line.partition(":") for line in lines)
            found = next((value.strip() for name, _, value in fields if name.strip() == "model name"), "")
        elif platform.system() == "Darwin":
            words = ["/usr/sbin/sysctl", "-n", "machdep.cpu.brand_string"]
            found = subprocess.run(words, capture_output=True, text=True, timeout=5, check=True).stdout.strip()
        else:
            found = platform.processor()
    except (OSError, subprocess.SubprocessError):
        found = ""
    return " ".join(found.split()) or platform.processor() or platform.machine() or "unknown processor"


def _cores() -> int:
    if hasattr(os, "sched_getaffinity"):
        return len(os.sched_getaffinity(0))
    return os.cpu_count() or 1


def _blas() -> str:
    """Name and version of numpy's linear algebra, as it was built."""
    told = np.show_config(mode="dicts")
    built = told.get("Build Dependencies", {}).get("blas", {}) if told else {}
    return f"{built.get('name', 'unknown BLAS')} {built.get('version', '')}".strip()


def _blas_threads(blas: str) -> int | None:
    names = next((names for kind, names in THREADS.items() if kind in blas.lower()), ())
    given = next((os.environ[name] for name in names if os.environ.get(name)), "")
    return int(given) if given.isdecimal() and int(given) > 0 else None


def _version(package: str) -> str:
    try:
        return version(package)
    except PackageNotFoundError:
        return "absent"


def _load() -> float | None:
    try:
        return os.getloadavg()[0]
    except (AttributeError, OSError):  # Windows has none
        return None
