"""Owns `python -m flutterviz`."""

from flutterviz.cli import main

if __name__ == "__main__":
    main()
