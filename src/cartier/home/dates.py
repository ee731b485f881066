"""Date of a recording: the times of its frames, where they count from 1970; others have an unknown beginning."""

from __future__ import annotations

from collections.abc import Iterable
from datetime import UTC, datetime

from cartier.types import MapObject

EARLIEST_S, AHEAD_S = 946_684_800.0, 86_400.0  # from 2000 on, and as far in the future as clocks may differ


def date_of(time_s: float, now_s: float) -> datetime | None:
    """The date of a frame's time; None if it counts from elsewhere, such as the start of the recording."""
    return datetime.fromtimestamp(time_s, UTC) if EARLIEST_S <= time_s <= now_s + AHEAD_S else None


def age_h(objects: Iterable[MapObject], now_s: float) -> float | None:
    """The hours since a home was last recorded; None where its recordings have no date."""
    latest_s = max((obj.last_looked_s for obj in objects), default=0.0)
    return None if date_of(latest_s, now_s) is None else round(max(0.0, now_s - latest_s) / 3600, 2)
