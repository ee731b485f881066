"""Stands in for AI2-THOR's Unity player: speaks its FIFO and WSGI protocols and serves homes of the dollhouse.

The real ``ai2thor.controller.Controller`` starts it in place of a build. It imports nothing from the ai2thor package,
so that the client is the only other party that must agree with it. What it sends is our reading of the protocol of
version 5.0.

    python standin.py HOME… [--legacy] [--fault exit:Teleport]

A HOME is one of the dollhouse's or a YAML file. The first is FloorPlan1 (and what ProcTHOR's "Procedural" shows), the
next FloorPlan2, and so on. ``--legacy`` sends an old build's normalised depth; ``--fault`` exits or hangs at an action.
"""

from __future__ import annotations

import argparse
import http.client
import json
import math
import os
import struct
import sys
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import msgpack
import numpy as np

from cartier.types import Camera
from cartier_dollhouse.model import Scene
from cartier_dollhouse.place import Plan
from cartier_dollhouse.render import Renderer, View
from cartier_dollhouse.scene import load_home, load_scene

METADATA, ACTION, RGB, DEPTH, IDS, END = 1, 2, 4, 5, 9, 255
PART_NAMES = {RGB: "image", DEPTH: "image_depth", IDS: "image_ids"}
AGENT_Y_M, EYE_M, RADIUS_M, NEAR_M, FAR_M = 0.9009992, 1.5759992, 0.2, 0.1, 20.0
NO_BOX = "Sink|+01.38|+00.81|-01.27|SinkBasin"  # whatever a build gives no box for must not trip the adapter
FLAGS = """
visible obstructed isInteractable receptacle toggleable isToggled breakable isBroken canFillWithLiquid
isFilledWithLiquid dirtyable isDirty canBeUsedUp isUsedUp cookable isCooked isHeatSource isColdSource sliceable isSliced
openable isOpen pickupable isPickedUp moveable isMoving
"""
Message = tuple[dict[str, Any], dict[int, bytes]]


def unity(xyz: Any) -> dict[str, float]:
    """A point of our world in Unity's frame: left-handed, y up."""
    return {"x": float(xyz[0]), "y": float(xyz[2]), "z": float(xyz[1])}


def object_id(type: str, middle: Any) -> str:
    """As Unity writes it: an exact zero has no sign."""
    return "|".join([type, *("00.00" if v == 0 else f"{v:+06.2f}" for v in unity(middle).values())])


PLANS: dict[int, Plan] = {}


def plan_of(scene: Scene) -> Plan:
    """Made once for each scene: some are shown again and again."""
    if id(scene) not in PLANS:
        PLANS[id(scene)] = Plan(scene, RADIUS_M)
    return PLANS[id(scene)]


class Player:
    """What Unity would do: an agent in a scene. Angles in degrees; yaw clockwise, horizon positive downwards."""

    def __init__(self, scenes: dict[str, Scene], width: int, height: int, legacy: bool) -> None:
        self.scenes, self.width, self.height, self.legacy = scenes, width, height, legacy
        self.options: dict[str, Any] = {}
        self.view: View | None = None
        self.seen_from: tuple[float, ...] = ()
        self.last: dict[str, Any] = {"action": "", "ok": True, "error": "", "code": None, "return": None}
        self.show(next(iter(scenes)))

    def show(self, name: str) -> None:
        self.name, self.scene, self.plan = name, self.scenes[name], plan_of(self.scenes[name])
        self.xy, self.yaw, self.horizon = np.array(self.scene.start_xy, float), 0.0, 0.0
        truth = self.scene.truth()
        self.objects = [self.described(t.label, np.array(t.box_min), np.array(t.box_max)) for t in truth]
        points = np.concatenate([part.vertices for part in self.scene.structure])
        self.objects += [self.described("Floor", points.min(0), points.max(0))]
        self.objects += [
            self.objects[0] | {"objectId": NO_BOX, "objectType": "SinkBasin", "axisAlignedBoundingBox": None}
        ]
        number = {t.id: i for i, t in enumerate(truth)}
        self.object_of = np.full(max(number) + 1, len(truth))  # the structure is the floor
        self.object_of[list(number)] = list(number.values())
        self.colours = np.random.default_rng(3).choice(2**24, len(self.objects), replace=False)
        self.renderer: Renderer | None = None

    @staticmethod
    def described(type: str, low: Any, high: Any) -> dict[str, Any]:
        middle, size = (low + high) / 2, unity(high - low)
        corners = [
            list(unity(c).values()) for c in np.stack(np.meshgrid(*zip(low, high, strict=True)), -1).reshape(-1, 3)
        ]
        return dict.fromkeys(FLAGS.split(), False) | {
            "name": f"{type}_0a1b2c3d", "objectType": type, "objectId": object_id(type, middle), "assetId": "",
            "position": unity(middle), "rotation": unity((0, 0, 0)), "mass": 1.0, "distance": 0.0, "openness": 0.0,
            "temperature": "RoomTemp", "salientMaterials": None, "receptacleObjectIds": None, "parentReceptacles": None,
            "controlledObjects": None, "fillLiquid": None, "objectOrientedBoundingBox": None,
            "axisAlignedBoundingBox": {"cornerPoints": corners, "center": unity(middle), "size": size},
        }  # fmt: skip

    def do(self, action: dict[str, Any]) -> None:
        """Carry out an action; what came of it goes into the next message."""
        name = action["action"]
        handler: Callable[[dict[str, Any]], Any] | None = getattr(self, f"do_{name}", None)
        self.last = {"action": name, "ok": True, "error": "", "code": None, "return": None}
        if handler is None:
            self.last |= {"ok": False, "error": f"Invalid action: {name}", "code": "InvalidAction"}
        else:
            self.last["return"] = handler(action)

    def do_GetScenesInBuild(self, action: dict[str, Any]) -> list[str]:
        return list(self.scenes)

    def do_Reset(self, action: dict[str, Any]) -> None:
        self.show(action["sceneName"])

    def do_CreateHouse(self, action: dict[str, Any]) -> None:
        if error := action["house"].get("refuse"):
            self.last |= {"ok": False, "error": error}

    def do_ChangeResolution(self, action: dict[str, Any]) -> None:
        self.width, self.height, self.renderer = int(action["x"]), int(action["y"]), None

    def do_Initialize(self, action: dict[str, Any]) -> dict[str, float] | None:
        self.options, self.renderer = action, None
        return None if self.legacy else {"cameraNearPlane": NEAR_M, "cameraFarPlane": FAR_M}

    def do_GetReachablePositions(self, action: dict[str, Any]) -> list[dict[str, float]]:
        step = self.options["gridSize"]
        seen, front = {(0, 0)}, [(0, 0)]
        while front:
            i, j = front.pop()
            for cell in ((i + 1, j), (i - 1, j), (i, j + 1), (i, j - 1)):
                if cell not in seen and self.plan.free(self.xy + step * np.array(cell)):
                    seen.add(cell)
                    front.append(cell)
        return [unity((*(self.xy + step * np.array(cell)), AGENT_Y_M)) for cell in sorted(seen)]

    def do_Teleport(self, action: dict[str, Any]) -> None:
        place = action.get("position") or action
        if not (action.get("forceAction") or self.plan.free((place["x"], place["z"]))):
            self.last |= {"ok": False, "error": "Collided with: the stand-in"}
            return
        self.xy, self.horizon = np.array([place["x"], place["z"]]), action.get("horizon", self.horizon)
        self.yaw = action.get("rotation", {"y": self.yaw})["y"] % 360

    do_TeleportFull = do_Teleport

    def message(self) -> Message:
        """The metadata of the agent, and the images as bytes with their rows bottom-up."""
        fov = self.options.get("fieldOfView", 90.0)
        if self.renderer is None:
            focal = self.height / 2 / math.tan(math.radians(fov / 2))  # Unity's field of view is vertical
            camera = Camera(self.width, self.height, focal, focal, (self.width - 1) / 2, (self.height - 1) / 2)
            self.renderer = Renderer(self.scene, camera, light=False)
            self.view = None
        seen_from = (*self.xy, self.yaw, self.horizon)
        if self.view is None or self.seen_from != seen_from:  # nothing moves but the agent
            self.view, self.seen_from = self.renderer.render(self.world_from_camera()), seen_from
        view = self.view
        images = {RGB: view.rgb}
        if self.options.get("renderDepthImage"):
            metres = np.where(np.isnan(view.depth_m), FAR_M, np.minimum(view.depth_m, FAR_M)).astype("<f4")
            images[DEPTH] = metres / np.float32(FAR_M - NEAR_M) if self.legacy else metres
        coloured = bool(self.options.get("renderInstanceSegmentation"))
        if coloured:
            colour = self.colours[self.object_of[view.instances]]
            images[IDS] = np.stack(
                [colour >> 16, colour >> 8 & 255, colour & 255, np.full_like(colour, 255)], -1
            ).astype("u1")
        metadata = self.metadata(fov) | {"colors": self.colour_table() if coloured else None}
        return metadata, {kind: np.ascontiguousarray(image[::-1]).tobytes() for kind, image in images.items()}

    def world_from_camera(self) -> np.ndarray:
        """A level camera that looks along +y, pitched about its own x axis, then turned clockwise about z."""
        down, turn = math.radians(self.horizon), math.radians(self.yaw)
        level = np.array([[1, 0, 0], [0, 0, 1], [0, -1, 0]], float)
        pitch = np.array([[1, 0, 0], [0, math.cos(down), math.sin(down)], [0, -math.sin(down), math.cos(down)]])
        clockwise = np.array([[math.cos(turn), math.sin(turn), 0], [-math.sin(turn), math.cos(turn), 0], [0, 0, 1]])
        pose = np.eye(4)
        pose[:3, :3], pose[:3, 3] = clockwise @ level @ pitch, (*self.xy, EYE_M)
        return pose

    def colour_table(self) -> list[dict[str, Any]]:
        rgb = [[int(c) >> 16, int(c) >> 8 & 255, int(c) & 255] for c in self.colours]
        table = [{"name": o["objectId"], "color": c} for o, c in zip(self.objects, rgb, strict=True)]
        types = sorted({o["objectType"] for o in self.objects})
        return table + [{"name": name, "color": [i, 1, 255]} for i, name in enumerate(types)]

    def metadata(self, fov: float) -> dict[str, Any]:
        last = self.last
        agent = {
            "name": "agent", "position": unity((*self.xy, AGENT_Y_M)), "rotation": {"x": 0.0, "y": self.yaw, "z": 0.0},
            "cameraHorizon": self.horizon, "isStanding": True, "inHighFrictionArea": False,
        }  # fmt: skip
        metadata = {
            "objects": self.objects, "agent": agent, "fov": fov, "cameraPosition": unity((*self.xy, EYE_M)),
            "sceneName": self.name, "lastAction": last["action"], "lastActionSuccess": last["ok"],
            "errorMessage": last["error"], "errorCode": last["code"], "actionReturn": last["return"],
            "screenWidth": self.width, "screenHeight": self.height, "thirdPartyCameras": [], "agentId": 0,
            "isSceneAtRest": True, "inventoryObjects": [], "collidedObjects": [], "collided": False, "currentTime": 0.0,
            "depthFormat": "Meters",
        }  # fmt: skip
        if self.legacy:
            del metadata["depthFormat"]
        return metadata


def wrapped(metadata: dict[str, Any], sequence: int) -> dict[str, Any]:
    return {"agents": [metadata], "thirdPartyCameras": [], "activeAgentId": 0, "sequenceId": sequence}


def serve_fifo(player: Player, fault: Callable[[str], None]) -> None:
    """Fields of (type, length) and body over two named pipes; the player speaks first."""
    with Path(os.environ["AI2THOR_FIFO_SERVER_PIPE_PATH"]).open("wb") as out:
        reply_fifo(out, player, 0)
        with Path(os.environ["AI2THOR_FIFO_CLIENT_PIPE_PATH"]).open("rb") as inp:
            action: dict[str, Any] = {}
            while len(head := inp.read(5)) == 5:
                kind, size = struct.unpack("!BI", head)
                if kind == ACTION:
                    action = json.loads(inp.read(size))
                elif kind == END:
                    fault(action["action"])
                    player.do(action)
                    reply_fifo(out, player, action["sequenceId"])


def reply_fifo(out: Any, player: Player, sequence: int) -> None:
    metadata, images = player.message()
    fields = {METADATA: msgpack.packb(wrapped(metadata, sequence)), **images, END: b""}
    for kind, body in fields.items():
        out.write(struct.pack("!BI", kind, len(body)) + body)
    out.flush()


def serve_wsgi(player: Player, fault: Callable[[str], None]) -> None:
    """One POST of multipart/form-data per message; the response is the next action."""
    connection = http.client.HTTPConnection(os.environ["AI2THOR_HOST"], int(os.environ["AI2THOR_PORT"]))
    sequence = 0
    while True:
        metadata, images = player.message()
        parts = [
            (f'{PART_NAMES[kind]}"; filename="image.dat', "application/octet-stream", body)
            for kind, body in images.items()
        ]
        text = 'text/plain; charset="utf-8"'
        parts += [("metadata", text, json.dumps(wrapped(metadata, sequence)).encode())]
        parts += [("token", text, os.environ["AI2THOR_CLIENT_TOKEN"].encode())]
        body = b"".join(
            f'--edge\r\nContent-Type: {kind}\r\nContent-disposition: form-data; name="{name}"\r\n\r\n'.encode()
            + data
            + b"\r\n"
            for name, kind, data in parts
        )
        headers = {"Content-Type": 'multipart/form-data; boundary="edge"'}
        connection.request("POST", "/train", body + b"--edge--\r\n", headers)
        action = json.loads(connection.getresponse().read())
        if "action" not in action:
            return
        fault(action["action"])
        player.do(action)
        sequence = action["sequenceId"]


def load(home: str) -> Scene:
    return load_scene(Path(home)) if home.endswith(".yaml") else load_home(home)


def main() -> None:
    parser = argparse.ArgumentParser(allow_abbrev=False)
    parser.add_argument("homes", nargs="+")
    parser.add_argument("--legacy", action="store_true")
    parser.add_argument("--fault", default=":")
    parser.add_argument("-screen-width", type=int, default=300)
    parser.add_argument("-screen-height", type=int, default=300)
    parser.add_argument("-screen-fullscreen")
    parser.add_argument("-screen-quality")
    given = parser.parse_args()
    what, when = given.fault.split(":")

    def fault(action: str) -> None:
        if action == when:
            sys.exit(3) if what == "exit" else time.sleep(3600)

    scenes = {f"FloorPlan{i}_physics": load(name) for i, name in enumerate(given.homes, 1)}
    scenes["Procedural"] = next(iter(scenes.values()))
    player = Player(scenes, given.screen_width, given.screen_height, given.legacy)
    serve = serve_wsgi if os.environ["AI2THOR_SERVER_TYPE"] == "WSGI" else serve_fifo
    serve(player, fault)


if __name__ == "__main__":
    main()
