"""Talk to a mapped home: a recording and a need in, the object that serves it and a reachable pose out."""

from cartier.errors import BackendError, CartierError, InputError, MissingExtra, ReasonerError
from cartier.types import Camera, Frame
