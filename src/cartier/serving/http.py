"""HTTP API of the operations, with OpenAPI, and the page that uses it."""

# No postponed annotations: FastAPI reads those of nested functions.

import asyncio
import functools
import json
import logging
from collections.abc import AsyncIterator, Callable
from importlib.metadata import version
from typing import Annotated, Any, Literal

from fastapi import FastAPI, Header, Query, Request
from fastapi.exceptions import RequestValidationError
from fastapi.responses import JSONResponse, Response, StreamingResponse
from pydantic import BaseModel, ConfigDict, Field
from starlette.exceptions import HTTPException

from cartier.errors import CartierError, InputError
from cartier.serving import api_page, page, results
from cartier.serving.operations import Operations
from cartier.serving.over_homes import ask_fleet
from cartier.serving.threads import Threads
from cartier.serving.values import wrong_value

THREADS = 4  # per home: slow requests to one home do not delay another
NAMES, ALL = " names", " all"  # look-ups of homes' names, and questions over all homes: no home has such a name
BEAT_S = 1.0  # between two `thinking` events

DOCUMENTATION = "/docs"
EVENTS: dict[int | str, dict[str, Any]] = {200: {"content": {"text/event-stream": {"schema": {"type": "string"}}}}}
PHOTO: dict[int | str, dict[str, Any]] = {
    200: {
        "content": {"image/jpeg": {"schema": {"type": "string", "format": "binary"}}},
        "headers": {"x-box": {"schema": {"type": "string"}, "description": "the object's box in it: [x1, y1, x2, y2]"}},
    }
}

Text = Annotated[str, Field(max_length=4000)]
Short = Annotated[str, Field(max_length=200)]
Metres = Annotated[float | None, Field(ge=-1e5, le=1e5)]
ShortQuery = Annotated[str, Query(max_length=200)]
MetresQuery = Annotated[float | None, Query(ge=-1e5, le=1e5)]


class Question(BaseModel):
    """What a person says; requests with the same ``conversation`` share their context."""

    model_config = ConfigDict(extra="forbid")
    words: Text
    conversation: Annotated[str, Field(max_length=64)] = ""
    from_x: Metres = None
    from_y: Metres = None


class FleetQuestion(BaseModel):
    """A question over all homes."""

    model_config = ConfigDict(extra="forbid")
    words: Text


class Correction(BaseModel):
    """A correction, and who makes it; ``Home.correct`` says which values each kind takes."""

    model_config = ConfigDict(extra="forbid")
    what: Literal["name", "confirm", "relabel", "add", "merge", "split", "forget", "move", "rule", "lift"]
    entity: Text = ""
    name: Short = ""
    x: Metres = None
    y: Metres = None
    other: Short = ""
    who: Short = "somebody"


class Who(BaseModel):
    """Who undoes a correction."""

    model_config = ConfigDict(extra="forbid")
    who: Short = "somebody"


class Verification(BaseModel):
    """A verification takes nothing: the owner of the server chooses who looks."""

    model_config = ConfigDict(extra="forbid")


def make(operations: Operations) -> FastAPI:
    """The app. It has no access control: put a ``Guard`` around it."""
    app = FastAPI(
        title="cartier", version=version("cartier"), docs_url=None, redoc_url=None, openapi_url="/openapi.json",
        summary="Talk to mapped homes: where objects are, how certain that is, and poses to reach them.",
        responses={"4XX": {"model": results.Fault, "description": "what is wrong, in one line"}},
    )  # fmt: skip
    threads = Threads(THREADS, {NAMES: 40})
    _add_faults(app)
    _add_page(app)
    _add_homes(app, operations, threads)
    for add in (_add_reading, _add_pictures, _add_writing):
        add(app, operations, functools.partial(_run, operations, threads))
    _add_documentation(app)
    return app


async def _run(operations: Operations, threads: Threads, home: str, work: Callable[..., Any], *given: Any) -> Any:
    """Run an operation on a home in one of its threads."""
    if not home.strip():
        raise InputError("there is no home '': /api/homes lists them")
    name = await threads.run(NAMES, operations.homes.name, home)  # a fleet's store may be slow
    return await threads.run(name, work, *given)


def _add_faults(app: FastAPI) -> None:
    @app.exception_handler(CartierError)
    async def mistake(request: Request, error: CartierError) -> JSONResponse:
        missing = isinstance(error, InputError) and str(error).startswith(("there is no home", "nothing in this home"))
        return JSONResponse({"error": str(error)}, 404 if missing else 400)

    @app.exception_handler(RequestValidationError)
    async def malformed(request: Request, error: RequestValidationError) -> JSONResponse:
        return JSONResponse({"error": wrong_value(error.errors()[0], skip=1)}, 422)

    @app.exception_handler(HTTPException)
    async def unknown(request: Request, error: HTTPException) -> JSONResponse:
        return JSONResponse({"error": str(error.detail)}, error.status_code)

    @app.exception_handler(Exception)
    async def broken(request: Request, error: Exception) -> JSONResponse:
        logging.getLogger("cartier").error("a request to %s failed", request.url.path, exc_info=error)
        return JSONResponse({"error": "the server failed: its log says why"}, 500)


def _add_page(app: FastAPI) -> None:
    for path, (kind, data) in page.files().items():

        def send(kind: str = kind, data: bytes = data) -> Response:
            return Response(data, media_type=kind, headers={"cache-control": "no-cache"})

        app.add_api_route(path, send, include_in_schema=False, response_model=None)


def _add_homes(app: FastAPI, ops: Operations, threads: Threads) -> None:
    @app.get("/api/homes", summary="The homes that are served")
    async def homes() -> results.Homes:
        return results.Homes(homes=await threads.run(NAMES, lambda: ops.homes.names))

    if ops.homes.fleet is None:
        return

    @app.post(
        "/api/fleet/ask", response_model=results.FleetAnswered,
        summary="The answer to a question over all homes: which have or lack something, how many, most, biggest",
    )  # fmt: skip
    async def ask_all(question: FleetQuestion) -> Response:
        return JSONResponse(await threads.run(ALL, ask_fleet, ops, question.words))


def _add_reading(app: FastAPI, ops: Operations, run: Callable[..., Any]) -> None:
    @app.post(
        "/api/homes/{home:path}/ask", response_model=results.Answered, responses=EVENTS,
        summary="The answer to a person's words; as server-sent events if accepted",
    )  # fmt: skip
    async def ask(home: str, question: Question, accept: Annotated[str, Header()] = "") -> Response:
        given = (home, ops.ask, question.words, home, question.conversation, question.from_x, question.from_y, True)
        if "text/event-stream" not in accept:
            return JSONResponse(await run(*given))
        return StreamingResponse(_events(functools.partial(run, *given)), media_type="text/event-stream")

    @app.get("/api/homes/{home:path}/find", response_model=results.FoundByName, summary="Objects and rooms by name")
    async def find(home: str, name: ShortQuery) -> Response:
        return JSONResponse(await run(home, ops.find, name, home))

    @app.get(
        "/api/homes/{home:path}/objects", response_model=results.ObjectList,
        summary="The objects of a home or of one room, one page at a time",
    )  # fmt: skip
    async def objects(
        home: str, room: ShortQuery = "", page: Annotated[int, Query(ge=1, le=100_000)] = 1, tentative: bool = False
    ) -> Response:
        return JSONResponse(await run(home, ops.list_objects, room, page, tentative, home))

    @app.get("/api/homes/{home:path}/rooms", response_model=results.RoomList, summary="The rooms of a home")
    async def rooms(home: str) -> Response:
        return JSONResponse(await run(home, ops.list_rooms, home))

    @app.get("/api/homes/{home:path}/live", response_model=results.LiveNow, summary="How mapping goes on, and where")
    async def live(home: str) -> Response:
        return JSONResponse({"live": await run(home, ops.homes.state)})

    @app.get("/api/homes/{home:path}/rules", response_model=results.RuleList, summary="The route rules of a home")
    async def rules(home: str) -> Response:
        return JSONResponse(await run(home, ops.list_rules, home))

    @app.get(
        "/api/homes/{home:path}/describe", response_model=results.ObjectDescription | results.RoomDescription,
        summary="All that is known about one object or room",
    )  # fmt: skip
    async def describe(home: str, entity: ShortQuery) -> Response:
        return JSONResponse(await run(home, ops.describe, entity, home))

    @app.get(
        "/api/homes/{home:path}/relate", response_model=results.Related, summary="The spatial relations of two objects"
    )
    async def relate(home: str, entity: ShortQuery, other: ShortQuery) -> Response:
        return JSONResponse(await run(home, ops.relate, entity, other, home))

    @app.get(
        "/api/homes/{home:path}/goal", response_model=results.ObjectPose | results.RoomPose,
        summary="A reachable goal pose that faces an object or lies in a room",
    )  # fmt: skip
    async def goal(home: str, entity: ShortQuery, from_x: MetresQuery = None, from_y: MetresQuery = None) -> Response:
        return JSONResponse(await run(home, ops.goal_for, entity, home, from_x, from_y))


def _add_pictures(app: FastAPI, ops: Operations, run: Callable[..., Any]) -> None:
    @app.get(
        "/api/homes/{home:path}/view",
        response_model=results.View,
        summary="The data of the page: floor plan, rooms, objects, route rules",
    )
    async def view(home: str) -> Response:
        return Response(await run(home, page.served_json, ops, home, page.view), media_type="application/json")

    @app.get(
        "/api/homes/{home:path}/cloud", response_model=results.Cloud,
        summary="The point cloud of the 3-D view, null without one",
    )  # fmt: skip
    async def cloud(home: str) -> Response:
        return Response(
            await run(home, page.served_json, ops, home, lambda mapped: {"cloud": page.cloud(mapped)}),
            media_type="application/json",
        )

    @app.get(
        "/api/homes/{home:path}/photo", summary="A photo of an object, its evidence, as JPEG; view 0 is the floor plan",
        response_class=Response, responses=PHOTO,
    )  # fmt: skip
    async def photo(home: str, entity: ShortQuery, view: Annotated[int, Query(ge=0, le=100)] = 1) -> Response:
        result, jpeg = await run(home, ops.look_at, entity, view, home)
        box = {"x-box": json.dumps(result["box_in_picture"])} if "box_in_picture" in result else {}
        return Response(jpeg, media_type="image/jpeg", headers=box)


def _add_writing(app: FastAPI, ops: Operations, run: Callable[..., Any]) -> None:
    @app.post(
        "/api/homes/{home:path}/corrections", response_model=results.Corrected,
        summary="Name, confirm, relabel, add, merge, split, forget or move; a route rule, or its end",
    )  # fmt: skip
    async def correct(home: str, made: Correction) -> Response:
        given = (made.entity, made.name, made.x, made.y, home, made.who, made.other)
        return JSONResponse(await run(home, ops.correct, made.what, *given))

    @app.post("/api/homes/{home:path}/undo", response_model=results.Corrected, summary="Undo the latest correction")
    async def undo(home: str, by: Who) -> Response:
        return JSONResponse(await run(home, ops.undo, home, by.who))

    @app.post(
        "/api/homes/{home:path}/verify", response_model=results.Verified,
        summary="Ask the owner's vision model once about doubtful objects; where the server may look (--look auto)",
    )  # fmt: skip
    async def verify(home: str, wish: Verification) -> Response:
        return JSONResponse(await run(home, ops.verify, home))


def _add_documentation(app: FastAPI) -> None:
    @functools.cache
    def described() -> bytes:
        return api_page.page(app.openapi()).encode()

    @app.get(DOCUMENTATION, include_in_schema=False)
    def documentation() -> Response:
        return Response(described(), media_type="text/html; charset=utf-8", headers={"cache-control": "no-cache"})


async def _events(work: Callable[[], Any]) -> AsyncIterator[str]:
    """Server-sent events: `thinking` while the answer takes its time, then `answer` or `fault`."""
    task = asyncio.ensure_future(work())
    try:
        while not (await asyncio.wait({task}, timeout=BEAT_S))[0]:
            yield "event: thinking\ndata: {}\n\n"
        yield f"event: answer\ndata: {json.dumps(task.result(), ensure_ascii=False)}\n\n"
    except CartierError as error:
        yield f"event: fault\ndata: {json.dumps({'error': str(error)})}\n\n"
    finally:
        task.cancel()
