"""Owns what all tests share: linear algebra on one thread, as the explorer has it."""

import flutterviz  # noqa: F401 - sets OPENBLAS_NUM_THREADS, which must come before numpy is imported
