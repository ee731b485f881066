"""Schemas of the results of the operations, as OpenAPI states them. Keys with a default may be left out."""

# No postponed annotations: FastAPI reads those models.

from typing import Any, Literal

from pydantic import BaseModel, ConfigDict, Field

from cartier.types import AlarmKind, AsOf, Status


class Part(BaseModel):
    """A part of a result."""

    model_config = ConfigDict(extra="forbid")


class Fault(Part):
    """What is wrong with a request, in one line."""

    error: str


class Result(Part):
    """Which home a result is about."""

    home: str = Field(description="its name on this server")
    home_id: str = Field(description="of its map; the same while nobody maps it again")
    age_h: float | None = Field(description="hours since it was recorded; null where its recordings have no date")
    as_of: AsOf | None = Field(None, description="of when it is, for a home that is being mapped")


class LiveNow(Part):
    """How mapping goes on."""

    live: dict[str, Any] | None = Field(description="the state; null for a home that is not being mapped")


class Homes(Part):
    homes: list[str]


class FleetAnswered(Part):
    """The answer to a question over all homes, with three values."""

    text: str
    value: Any = Field(description="names of homes, a number, numbers by home, or a home and the id of an object")
    has: list[str] = Field(description="the homes that have what was asked for")
    has_none: list[str] = Field(description="those that have it not, though it was looked for")
    cannot_tell: dict[str, str] = Field(description="why nobody can tell, by home")


class Way(Part):
    """How a path follows route rules, which are in their text form: ``avoid room:bedroom hard standing``."""

    rules: list[str] = Field(description="those that hold for this drive")
    breaks: list[str] = Field(description="hard rules that it breaks, because a person agreed")
    shortest_m: float = Field(description="how long the way would be without rules")
    directions: list[str] = Field(description="the way in words, a step each")
    alternatives: list[str] = Field(description="other ways, with their difference of length")
    shortest_path: list[tuple[float, float]] = Field(description="corners of the way without rules")


class Pose(Part):
    """A reachable pose in the map frame, and the way there."""

    x: float
    y: float
    yaw: float = Field(description="rad, counter-clockwise from +x")
    length_m: float
    sees_it: bool = Field(description="whether nothing known stands in between")
    path: list[tuple[float, float]] = Field(description="corners of the way there")
    route: Way | None = Field(None, description="left out where no rule holds")


class Posed(Part):
    goal: Pose | None = None
    why_no_goal: str | None = None


class ObjectRow(Part):
    id: int
    label: str
    name: str | None = Field(None, description="what a person calls it")
    room: str | None
    x: float = Field(description="of the middle of its box, m")
    y: float
    z: float
    certainty: float = Field(description="how likely it exists, 0 to 1")
    evidence: str
    reachable: bool
    confirmed: bool = Field(True, description="left out where true; false for a tentative object")


class RoomRow(Part):
    room: str = Field(description="room:ID, which operations take as entity")
    name: str
    kind: str
    area_m2: float
    objects: int


class AnswerPart(Part):
    """The answer to one need."""

    status: Status
    object: str | None = None
    id: int | None = Field(None, description="of the object")
    alarm: AlarmKind | None = None
    text: str | None = None
    reason: str | None = None
    question: str | None = None
    ids: list[int] = Field([], description="objects that the answer or the question is about")
    tentative: int | None = Field(None, description="an object that it speaks of and that is not confirmed")
    rules: list[str] = Field([], description="route rules in the words")
    lifts: list[str] = Field([], description="route rules that the words take back")
    candidates: list[tuple[str, float]] = []
    name: str | None = None
    room: str | None = None
    certainty: float | None = None
    evidence: str | None = None
    x: float | None = None
    y: float | None = None
    z: float | None = None
    goal: Pose | None = None
    notes: list[str] = []
    as_of: AsOf | None = Field(None, description="of when it is, for a home that is being mapped")
    next: list["AnswerPart"] = Field([], description="the answers to further needs, in order")


class Answered(Result, AnswerPart):
    """The answer to a person's words."""

    corrected: bool = Field(False, description="whether the words corrected the home")


class ObjectList(Result):
    total: int
    page: int
    pages: int
    maybe: int = Field(0, description="how many more are tentative")
    objects: list[ObjectRow]


class RoomList(Result):
    rooms: list[RoomRow]


class RuleRow(Part):
    id: str = Field(description="which a correction of the kind lift takes as entity")
    rule: str = Field(description="its text form")
    words: str
    said: str = Field(description="the sentence that made it")
    made: str
    holds: Literal["now", "later", "expired"]


class RuleList(Result):
    rules: list[RuleRow]


class ObjectDescription(Result, ObjectRow, Posed):
    size_m: list[float]
    colours: list[str]
    also_called: list[str]
    stands: str | None
    holds: list[str]
    next_to: list[str]
    last_seen_s: float
    last_looked_s: float


class RoomDescription(Result, RoomRow, Posed):
    holds: list[str]


class NamedRow(ObjectRow):
    matched: str | None = Field(None, description="by which label, where the object is called otherwise")


class NamedRoom(Part):
    room: str
    name: str


class FoundByName(Result):
    total: int
    objects: list[NamedRow]
    rooms: list[NamedRoom]
    maybe: int = Field(0, description="how many more are tentative or have the name in some frames only")
    spelt: list[str] = Field([], description="names of like spelling that were taken instead")
    next: str | None = None


class Related(Result):
    relations: list[str]
    certainty: list[float]
    side: Literal["left", "right"] | None
    apart_m: float
    same_room: bool
    seen_from: list[float]
    evidence: list[str]


class ObjectPose(Result, ObjectRow, Posed):
    pass


class RoomPose(Result, RoomRow, Posed):
    pass


class Corrected(Result):
    done: str
    next: str | None = None


class Weights(Part):
    """What the model said of objects beyond doubt, by their names and by others, and what its answers count."""

    named: dict[str, int]
    misnamed: dict[str, int]
    yes: float = Field(description="by how much a yes multiplies the odds that an object is there")
    no: float


class Looked(Part):
    id: int
    label: str
    said: str = Field(description="yes, no or cannot tell")
    chosen: str = Field(description="of a contested label, the one that was chosen")
    factor: float
    before: float = Field(description="how likely it was")
    after: float
    why: str
    asked: bool
    frames: list[int] = Field(description="the photographs that were sent")


class Verified(Result):
    model: str = Field(description="the vision model, and where the photographs went")
    weights: Weights
    asked: list[Looked]
    not_asked: int = Field(description="doubtful objects that no photograph shows large enough")
    next: str


class ViewRoom(Part):
    id: int
    name: str
    kind: str
    area: float
    at: list[float]


class ViewObject(Part):
    id: int
    label: str
    names: list[str]
    also: list[str]
    room: int | None
    at: list[float]
    low: list[float]
    high: list[float]
    probability: float
    confirmed: bool
    n_detected: int
    n_observable: int
    colours: list[str]
    last_s: float
    views: int
    said: bool
    on: tuple[Any, ...] | None = Field(description="on or in, and the id of what it is on or in")


class ViewGrid(Part):
    """The floor plan: runs of (code, count), row by row; code % 3 is 0 unknown, 1 free, 2 occupied."""

    rows: int
    cols: int
    side: float
    origin: list[float]
    cells: list[int]
    heights: list[int]
    step: float


class View(Result):
    """What the page draws."""

    title: str
    detector: str
    start: list[float]
    extent: list[float]
    notes: list[str]
    corrections: int
    objects: list[ViewObject]
    rules: list[RuleRow] = Field(description="its route rules, with the sentences that made them")
    rooms: list[ViewRoom]
    grid: ViewGrid | None


class Points(Part):
    """Points in base64: x, y, z (uint16, in ``step`` metres from ``low``) of all, then RGB, then widths (uint8)."""

    count: int
    low: list[float]
    step: float
    side: float
    points: str


class Cloud(Result):
    cloud: Points | None
