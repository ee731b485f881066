"""HTTP API of the operations, with OpenAPI, and the page that uses it."""

# No postponed annotations: FastAPI reads those of nested functions.

import asyncio
import functools
import json
import logging
from collections.abc import AsyncIterator, Callable
from importlib.metadata import version
from typing import Annotated, Any, Literal

import anyio
import anyio.to_thread
from fastapi import FastAPI, Header, Query, Request
from fastapi.exceptions import RequestValidationError
from fastapi.responses import JSONResponse, Response, StreamingResponse
from pydantic import BaseModel, ConfigDict, Field
from starlette.exceptions import HTTPException

from cartier.errors import CartierError, InputError
from cartier.serving import page
from cartier.serving.operations import Operations

THREADS = 4  # per home: slow requests to one home do not delay another
BEAT_S = 1.0  # between two `thinking` events

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


class Correction(BaseModel):
    """A correction, and who makes it; ``Home.correct`` says which values each kind takes."""

    model_config = ConfigDict(extra="forbid")
    what: Literal["name", "confirm", "relabel", "add", "merge", "split", "forget", "move"]
    entity: Short = ""
    name: Short = ""
    x: Metres = None
    y: Metres = None
    other: Short = ""
    who: Short = "somebody"


class Who(BaseModel):
    """Who undoes a correction."""

    model_config = ConfigDict(extra="forbid")
    who: Short = "somebody"


def make(operations: Operations) -> FastAPI:
    """The app. It has no access control: put a ``Guard`` around it."""
    app = FastAPI(
        title="cartier", version=version("cartier"), docs_url=None, redoc_url=None, openapi_url="/openapi.json",
        summary="Talk to mapped homes: where objects are, how certain that is, and poses to reach them.",
    )  # fmt: skip
    limits = {name: anyio.CapacityLimiter(THREADS) for name in operations.homes.names}
    _add_faults(app)
    _add_page(app)
    _add_reading(app, operations, functools.partial(_run, operations, limits))
    _add_writing(app, operations, functools.partial(_run, operations, limits))
    return app


async def _run(
    operations: Operations, limits: dict[str, anyio.CapacityLimiter], home: str, work: Callable[..., Any], *given: Any
) -> Any:
    """Run an operation on a home in one of its threads."""
    name = operations.homes.name(home)
    return await anyio.to_thread.run_sync(functools.partial(work, *given), limiter=limits[name])


def _add_faults(app: FastAPI) -> None:
    @app.exception_handler(CartierError)
    async def mistake(request: Request, error: CartierError) -> JSONResponse:
        missing = isinstance(error, InputError) and str(error).startswith(("there is no home", "nothing in this home"))
        return JSONResponse({"error": str(error)}, 404 if missing else 400)

    @app.exception_handler(RequestValidationError)
    async def malformed(request: Request, error: RequestValidationError) -> JSONResponse:
        first = error.errors()[0]
        where = ".".join(str(part) for part in first["loc"][1:])
        return JSONResponse({"error": f"{where or 'the request'}: {first['msg']}"}, 422)

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


def _add_reading(app: FastAPI, ops: Operations, run: Callable[..., Any]) -> None:
    @app.get("/api/homes", summary="The homes that are served")
    async def homes() -> dict[str, list[str]]:
        return {"homes": ops.homes.names}

    @app.post("/api/homes/{home}/ask", summary="The answer to a person's words; as server-sent events if accepted")
    async def ask(home: str, question: Question, accept: Annotated[str, Header()] = "") -> Any:
        given = (home, ops.ask, question.words, home, question.conversation, question.from_x, question.from_y, True)
        if "text/event-stream" not in accept:
            return await run(*given)
        return StreamingResponse(_events(functools.partial(run, *given)), media_type="text/event-stream")

    @app.get("/api/homes/{home}/view", summary="The data of the page: floor plan, rooms, objects")
    async def view(home: str) -> Any:
        return Response(await run(home, page.served_json, ops, home, page.view), media_type="application/json")

    @app.get("/api/homes/{home}/cloud", summary="The point cloud of the 3-D view, null without one")
    async def cloud(home: str) -> Any:
        return Response(
            await run(home, page.served_json, ops, home, lambda mapped: {"cloud": page.cloud(mapped)}),
            media_type="application/json",
        )

    @app.get("/api/homes/{home}/find", summary="Objects and rooms by name")
    async def find(home: str, name: ShortQuery) -> Any:
        return await run(home, ops.find, name, home)

    @app.get("/api/homes/{home}/objects", summary="The objects of a home or of one room, one page at a time")
    async def objects(
        home: str, room: ShortQuery = "", page: Annotated[int, Query(ge=1, le=100_000)] = 1, tentative: bool = False
    ) -> Any:
        return await run(home, ops.list_objects, room, page, tentative, home)

    @app.get("/api/homes/{home}/rooms", summary="The rooms of a home")
    async def rooms(home: str) -> Any:
        return await run(home, ops.list_rooms, home)

    @app.get("/api/homes/{home}/describe", summary="All that is known about one object or room")
    async def describe(home: str, entity: ShortQuery) -> Any:
        return await run(home, ops.describe, entity, home)

    @app.get("/api/homes/{home}/relate", summary="The spatial relations of two objects")
    async def relate(home: str, entity: ShortQuery, other: ShortQuery) -> Any:
        return await run(home, ops.relate, entity, other, home)

    @app.get("/api/homes/{home}/goal", summary="A reachable goal pose that faces an object or lies in a room")
    async def goal(home: str, entity: ShortQuery, from_x: MetresQuery = None, from_y: MetresQuery = None) -> Any:
        return await run(home, ops.goal_for, entity, home, from_x, from_y)

    @app.get("/api/homes/{home}/photo", summary="A photo of an object, its evidence, as JPEG", response_class=Response)
    async def photo(home: str, entity: ShortQuery, view: Annotated[int, Query(ge=1, le=100)] = 1) -> Response:
        result, jpeg = await run(home, ops.look_at, entity, view, home)
        return Response(jpeg, media_type="image/jpeg", headers={"x-box": json.dumps(result["box_in_picture"])})


def _add_writing(app: FastAPI, ops: Operations, run: Callable[..., Any]) -> None:
    @app.post("/api/homes/{home}/corrections", summary="Name, confirm, relabel, add, merge, split, forget or move")
    async def correct(home: str, made: Correction) -> Any:
        given = (made.entity, made.name, made.x, made.y, home, made.who, made.other)
        return await run(home, ops.correct, made.what, *given)

    @app.post("/api/homes/{home}/undo", summary="Undo the latest correction")
    async def undo(home: str, by: Who) -> Any:
        return await run(home, ops.undo, home, by.who)


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
