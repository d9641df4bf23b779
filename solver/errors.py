"""Owns the errors that a user can cause and mend: one line saying what is wrong and what to do."""


class DesignError(ValueError):
    """A Design, or a file or preset that should hold one, is not usable as given."""


class ControlError(ValueError):
    """The regulator asked for does not exist, as for an unstable mode that no patch can reach."""
