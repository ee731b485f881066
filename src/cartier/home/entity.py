"""Mapped home: the frozen entity that ``map_home`` makes and ``ask`` reads, and the queries that both need."""

from __future__ import annotations

import json
from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property, partial
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from cartier import plugins
from cartier.contracts import Instances, Searchable, SpatialIndex
from cartier.errors import InputError
from cartier.home import compaction, correction_log, corrections, repository, views
from cartier.home.data import HomeData, origin_of
from cartier.home.detection_log import DetectionLog
from cartier.home.photos import photo_of
from cartier.home.point_cloud import PointCloud, read_cloud
from cartier.navigation.layers import RouteMap
from cartier.navigation.planning import reach, room_middle
from cartier.spatial.doors import find_doors, shut_doors
from cartier.types import Answer, Door, Inventory, Place, RobotModel, Room, Selection
from cartier.types.route_rules import RouteRule

ANSWERS, MAX_ANSWERS_BYTES = "answers.jsonl", 2**24
CLOUD, DETECTIONS = "cloud.npz", "detections.npz"
"""Keys of ``Home.growth`` under which the point cloud and the log of detections are kept."""


@dataclass(frozen=True, eq=False)
class Home(HomeData):
    """A mapped home. It is immutable: growing and correcting give a new one.

    ``map_home`` and ``Mapper.home`` make homes; ``Home.load`` reads a saved one. Positions are in the map frame:
    metres, z up, floor at z = 0.

    Args:
        name: Its name: what people call it, else the folder that ``cartier map`` wrote, or its first recording.
        detector: The name of the detector that mapped it.
        camera: The camera of the recordings.
        objects: All objects of the map, confirmed and tentative, with corrections applied.
        indexes: The spatial indices by name; the first one is the default.
        grid: The floor plan, or None if the recordings have no depth.
        start_xy: Where the first recording began (x, y), metres.
        settings: Everything that made the map (recordings, detector, encoder, …), as JSON values.
        rooms: The rooms of the floor plan, with corrections applied.
        photos: JPEG bytes by frame number, of the frames that the objects' views name.
        notes: What a person should know about this map, one line each.
        growth: The state from which mapping goes on, as named blobs.
        store: Where it was loaded from, or None.
        corrected: The objects, rooms and name with and without the corrections that people made, or None if it was
            neither loaded nor grown from a loaded one.

    Example:
        >>> import cartier
        >>> walk = cartier.make("worlds", "dollhouse", width=160, height=120).explore("studio", max_frames=12)
        >>> truth = cartier.make("detectors", "ground_truth", truth=walk.truth, source="dollhouse")
        >>> home = cartier.map_home(walk, truth)
        >>> import tempfile
        >>> with tempfile.TemporaryDirectory() as folder:
        ...     home.save(folder)
        ...     again = cartier.Home.load(folder)
        >>> again.id == home.id, again.names == home.names
        (True, True)
    """

    def inventory(
        self, index: str | None = None, from_xy: Sequence[float] | None = None, rules: Sequence[RouteRule] = ()
    ) -> Inventory:
        """What a reasoner may choose from.

        Args:
            index: The name of an index, by default the first one. An index with names of its own (such as the paper's)
                gives an inventory of bare names.
            from_xy: Where the robot stands (x, y), metres; by default ``start_xy``.
            rules: The route rules that hold.

        Returns:
            The objects and rooms, or the index's names.

        Raises:
            InputError: The home has no such index.
        """
        names, at = self.index(index)[1].names(), tuple(self.start_xy if from_xy is None else from_xy)
        if set(names) <= set(self.names):
            return Inventory(
                self.objects, self.rooms, self.photo, at, self._doors, tuple(rules), self._shut_doors,
                partial(self._way_m, at),
            )  # fmt: skip
        return Inventory.of(names)

    def _way_m(self, from_xy: tuple[float, ...], object_id: int) -> float | None:
        """The length of the way of a robot of the usual size to an object."""
        obj = next((obj for obj in self.objects if obj.id == object_id), None)
        if self.grid is None or obj is None:
            return None
        area = reach(self.grid, from_xy, RobotModel.radius_m)
        return None if area is None else area.way_m(obj.box_min, obj.box_max)

    @cached_property
    def route_map(self) -> RouteMap | None:
        """What route rules are about: the floor plan with rooms, objects and doors; None without depth."""
        return None if self.grid is None else RouteMap(self.grid, self.rooms, self.objects, self._doors)

    @cached_property
    def _doors(self) -> tuple[Door, ...]:
        return find_doors(self.rooms, self.grid) if self.grid is not None else ()

    @cached_property
    def _shut_doors(self) -> tuple[Door, ...]:
        earlier = self.settings.get("doors", ())
        if self.grid is None or not earlier:
            return ()
        return shut_doors([(x, y, width_m) for x, y, width_m in earlier], self._doors, self.rooms, self.grid)

    def locate(self, chosen: Selection, index: str | None = None) -> Place | None:
        """Where a reasoner's choice is.

        Args:
            chosen: The choice. Its object id, where it has one, decides among objects of one name.
            index: The name of an index, by default the first one.

        Returns:
            The place of the object, the middle of the chosen room or door, or None if nothing was chosen or the index
            has no place.

        Raises:
            InputError: The home has no such index.
        """
        if chosen.object is None:
            return None
        if chosen.door is not None:
            x, y = self._doors[chosen.door].xy
            return Place(chosen.object, (x, y, 0.0), 1.0, -1)
        if chosen.room is not None:
            return self._room_place(next(room for room in self.rooms if room.id == chosen.room))
        held = self.index(index)[1]
        obj = next((o for o in self.objects if o.id == chosen.object_id), None)
        if obj is None or not isinstance(held, Instances):
            place = held.locate(chosen.object)
        else:
            place = held.locate_object(obj)
        found = self._said_place(chosen) if place is None else place
        return found and self.in_its_room(found)

    def in_its_room(self, place: Place) -> Place:
        """A place with the floor of the room in which its object stands, so that a goal lies there.

        Args:
            place: The place of an object.

        Returns:
            The place, unchanged where the map knows no room of the object.
        """
        number = next((obj.room for obj in self.objects if obj.id == place.object_id), None)
        cells = next((room.cells for room in self.rooms if room.id == number), None)
        return place if cells is None else replace(place, room_cells=cells)

    def _said_place(self, chosen: Selection) -> Place | None:
        """Where a person said that an object is which no index knows."""
        for obj in self.objects:
            mine = chosen.object_id == obj.id or (chosen.object_id is None and chosen.object in (obj.label, *obj.names))
            if obj.by_person and mine:
                return Place(
                    obj.label, obj.position, 1.0, -1, box_min=obj.box_min, box_max=obj.box_max, object_id=obj.id
                )
        return None

    def _room_place(self, room: Room) -> Place | None:
        """The middle of a room, with the frame that shows most of it. None without a floor plan."""
        if self.grid is None:
            return None
        x, y = room_middle(room, self.grid)
        views = [view for obj in self.objects if obj.room == room.id for view in obj.views]
        best = max(views, key=lambda view: view.size_px2, default=None)
        return Place(room.name, (x, y, 0.0), 1.0, best.frame if best else -1)

    def photo(self, object_id: int) -> bytes | None:
        """The photo of an object's best view.

        Args:
            object_id: The id of an object, or one of its aliases.

        Returns:
            JPEG bytes, or None for an unknown id or a photo that was not kept.

        Raises:
            InputError: The saved photo is damaged.
        """
        obj = next((o for o in self.objects if object_id == o.id or object_id in o.aliases), None)
        return self.photos.get(obj.views[0].frame) if obj is not None and obj.views else None

    def evidence(self, place: Place) -> npt.NDArray[np.uint8] | None:
        """The photo that shows a place.

        Args:
            place: A place of this home.

        Returns:
            RGB (H, W, 3) uint8, or None if the frame was not kept.

        Raises:
            InputError: The photo is damaged.
        """
        return photo_of(self, place.frame)

    def cloud(self) -> PointCloud | None:
        """The coloured points that depth showed.

        Returns:
            The cloud in the map frame (metres), or None without depth.

        Raises:
            InputError: The saved cloud is damaged.
        """
        data = self.growth.get(CLOUD)
        return None if data is None else read_cloud(data)

    def detections(self) -> DetectionLog | None:
        """The log of detections of all frames that the detector processed.

        Returns:
            The log, or None for a home that was built without one.

        Raises:
            InputError: The saved log is damaged.
        """
        if (data := self.growth.get(DETECTIONS)) is None:
            return None
        log = DetectionLog()
        log.restore(data)
        return log

    def index(self, name: str | None = None) -> tuple[str, SpatialIndex]:
        """An index of the home.

        Args:
            name: Its name; by default the first one.

        Returns:
            The name and the index.

        Raises:
            InputError: The home has no such index.
        """
        name = name or next(iter(self.indexes))
        if name not in self.indexes:
            known = [b.name for b in plugins.backends("indexes")]
            built = ", ".join(self.indexes)
            mend = f"map it again with --index {name}" if name in known else f"there are {', '.join(known)}"
            raise InputError(f"this home has no index {name!r} (it has {built}); {mend}")
        return name, self.indexes[name]

    def searchable(self, name: str | None = None) -> tuple[str, Searchable]:
        """An index in which any words can be looked up, not only the names of detected objects.

        Args:
            name: Its name; by default the first that can.

        Returns:
            The name and the index.

        Raises:
            InputError: The home has no such index, or the index named is not searchable.
        """
        for candidate in [name] if name else self.indexes:
            index = self.index(candidate)[1]
            if isinstance(index, Searchable):
                return str(candidate), index
        raise InputError(
            f"{f'index {name}' if name else 'no index of this home'} can be searched with any words; "
            "map it again with --index object_depth,object_viewpoint,vlmaps"
        )

    def to_dict(self) -> dict[str, Any]:
        """Everything that was found, as plain JSON values: what ``cartier show --json`` prints.

        Returns:
            ``home``, ``id``, ``detector``, ``objects``, ``rooms``, ``scale_guessed`` and ``notes``. Beside its fields,
            each object has ``located``, ``size_m`` (x, y, z, metres; of an object that is not located, the size of the
            box that covers where it may be) and ``on``: what it stands on or in, where depth shows that.
        """
        return views.to_dict(self)

    def correct(
        self,
        what: correction_log.CorrectionKind,
        entity: int | str = "",
        *,
        name: str = "",
        to_xy: Sequence[float] = (),
        other: int | str = "",
        who: str = "somebody",
    ) -> tuple[Home, str]:
        """Correct the home; the correction is appended to the log of the saved home.

        What a person says outweighs any score: an object that is named, confirmed, relabelled, moved, merged, split or
        added is confirmed, also after the home has grown, and a forgotten one does not come back.

        Args:
            what: "name" (give an object, a room or the home a name), "confirm" (an object is there), "relabel" (say
                what it is), "add" (an object that the map lacks), "merge" (two objects, or two rooms, are one),
                "split" (one object or room is two), "forget" (remove an object), "move" (move an object's middle),
                "rule" (a route rule for drives to come), "lift" (a route rule ends) or "undo" (take the latest
                correction back).
            entity: What to correct: an object's id, ``room:ID``, a name, a label that only one object has, or
                ``home``. For "add" the object that it stands on, or its room; for "rule" the rule in its text form,
                such as ``avoid room:bedroom hard standing``; for "lift" that, or its id.
            name: The new name for "name", the label for "relabel" and "add"; for "split" the label of the second
                object, or the second room's name, by default that of the first; for "rule" the sentence that made it.
            to_xy: A place (x, y) in metres, map frame: the new middle for "move", the middle for "add", a point of the
                second object for "split", or of the border of a room.
            other: For "merge" the object or room that becomes part of ``entity``.
            who: Who corrects, for the log.

        Returns:
            The corrected home, and a sentence that says what was done.

        Raises:
            InputError: The home was not loaded from a folder, the entity is unknown or ambiguous, or a value is
                invalid.
        """
        if self.store is None or self.corrected is None:
            raise InputError(f"{self.name} was not loaded from a folder: save it, load it, and correct it then")
        wish = corrections.Wish(what, str(entity), name, tuple(to_xy), str(other), who)
        entry = corrections.make(self.corrected, self.grid, wish, origin_of(self.settings))
        compaction.add(self.store, entry)
        return repository.again(self), correction_log.in_words(entry, self.corrected.log)

    def remember(self, answer: Answer) -> None:
        """Append an answer to the saved home's ``answers.jsonl``; a home that was not loaded keeps none.

        Of an alarm only the kind is kept, not the person's words. Beyond 16 MiB, the older half of the answers goes.

        Args:
            answer: What ``ask`` gave.

        Raises:
            InputError: The file cannot be written.
        """
        if self.store is not None:
            alarm = answer.selection.alarm
            kept = answer.to_dict() if alarm is None else {"status": "alarm", "alarm": alarm}
            self.store.append(ANSWERS, json.dumps(kept, ensure_ascii=False), MAX_ANSWERS_BYTES)

    def save(self, folder: str | Path) -> None:
        """Write the home to a folder, atomically: an older home there stays until the new one is complete.

        Args:
            folder: Where to; it is created if need be.

        Raises:
            InputError: The folder cannot be written.
        """
        repository.save(self, folder)

    @classmethod
    def load(cls, folder: str | Path) -> Home:
        """Read a saved home, while others may replace it.

        Args:
            folder: What ``save`` wrote, or the place of a home in a fleet's store: ``s3://BUCKET/homes/KEY``.

        Returns:
            The home, with the corrections of its log applied.

        Raises:
            InputError: The folder holds no home, or one of another schema, or is damaged.
        """
        return repository.load(folder, cls)
