"""What goes wrong on the user's side: each message is one line that says what, where, and how to mend it."""

from __future__ import annotations


class CartierError(Exception):
    """A fault that the user can mend. The command line prints the message alone and exits with 1."""


class InputError(CartierError):
    """A recording, a detections file, a model or a saved home is not what it should be."""


class BackendError(CartierError):
    """A backend is unknown, was given an option that it does not have, or misbehaved."""


class MissingExtra(BackendError):
    """A backend needs a package that is not installed."""


class ReasonerError(CartierError):
    """A language model could not be reached or refused to work. Rubbish in a reply is not an error but no answer."""
