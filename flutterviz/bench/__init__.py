"""Owns what `flutterviz bench` measures on this machine, a part of the program in each file."""
