"""Owns what all tests share: linear algebra on one thread, as the explorer has it, and the fixtures of pages."""

import flutterviz  # noqa: F401 - sets OPENBLAS_NUM_THREADS, which must come before numpy is imported

pytest_plugins = ("pages",)
