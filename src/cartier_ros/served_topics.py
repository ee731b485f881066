"""ROS 2 topics of a home that is being mapped: its objects for programs and RViz, questions in and answers out."""

from __future__ import annotations

import json
import threading
from collections.abc import Callable
from typing import Any

from cartier.errors import CartierError, InputError
from cartier.serving.operations import Operations
from cartier_ros.bags.bag import decoded
from cartier_ros.dds.domain import domain_of
from cartier_ros.dds.objects import DETECTIONS, MARKERS, detections, markers
from cartier_ros.dds.topics import Offer, Reader, Writer, participant
from cartier_ros.dds.types import encoded, message

OBJECTS, BOXES, ASK, ANSWER = "/cartier/objects", "/cartier/markers", "/cartier/ask", "/cartier/answer"
STRING = "std_msgs/msg/String"
TICK_S, LOOK_TICKS = 0.1, 10  # how often questions are taken; every tenth time it is seen whether the map has grown


class HomeTopics:
    """Publishes the objects of a home whenever they change, and answers one question after the other.

    Args:
        operations: What answers.
        domain: The DDS domain; None is that of the environment.
        frame: Tells the frame in which the home is mapped.

    Raises:
        BackendError: DDS cannot use the network.
    """

    def __init__(self, operations: Operations, domain: int | None, frame: Callable[[], str]) -> None:
        self._operations, self._frame, self._shown = operations, frame, ""
        self.domain = domain_of(domain, "--publish")
        self._participant = participant(self.domain)
        self._objects = Writer(self._participant, OBJECTS, DETECTIONS, 1, latched=True)
        self._markers = Writer(self._participant, BOXES, MARKERS, 1, latched=True)
        self._answers = Writer(self._participant, ANSWER, STRING)
        self._questions = Reader(self._participant, Offer(ASK, STRING, True, False), 10)
        self._stopped = threading.Event()
        self._thread = threading.Thread(target=self._run, daemon=True)
        self._thread.start()

    def close(self) -> None:
        """End it, after the objects were published as they are now."""
        self._stopped.set()
        self._thread.join()
        self._publish()

    def _run(self) -> None:
        ticks = 0
        while not self._stopped.wait(TICK_S):
            for data in self._questions.take():
                self._answers.write(encoded(message(STRING, data=json.dumps(self._answer(data), ensure_ascii=False))))
            ticks += 1
            if ticks % LOOK_TICKS == 0:
                self._publish()

    def _publish(self) -> None:
        try:
            home = self._operations.homes.get()
        except InputError:
            return  # there is no map yet
        if home.id == self._shown:
            return
        self._shown, frame = home.id, self._frame()
        self._objects.write(encoded(detections(home.objects, frame)))
        self._markers.write(encoded(markers(home.objects, frame)))

    def _answer(self, data: bytes) -> dict[str, Any]:
        """What ``Operations.ask`` returns, with the words; or the words and an ``error``."""
        try:
            words = str(decoded(data, STRING, "cdr", "a question").data)
        except InputError as error:
            return {"words": "", "error": str(error)}
        try:
            return {"words": words} | self._operations.ask(words, conversation="ros2")
        except CartierError as error:
            return {"words": words[:1000], "error": str(error)}
