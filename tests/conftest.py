"""Owns what all tests share: linear algebra on one thread, as the explorer has it, Ctrl-C, and pages."""

import signal

import flutterviz  # noqa: F401 - sets OPENBLAS_NUM_THREADS, which must come before numpy is imported

if signal.getsignal(signal.SIGINT) is signal.SIG_IGN:  # as in a shell's background job, whose children would inherit it
    signal.signal(signal.SIGINT, signal.default_int_handler)

pytest_plugins = ("pages",)
