"""Homes as resources of the MCP server, and its tool for questions over all homes of a fleet."""

import json
from collections.abc import Callable
from typing import Annotated, Any

import anyio.to_thread
from mcp.server import MCPServer
from mcp.server.mcpserver.exceptions import ResourceError
from mcp_types import CallToolResult, Resource, ToolAnnotations
from pydantic import BaseModel, Field

from cartier.errors import CartierError
from cartier.serving.operations import Operations
from cartier.serving.over_homes import ask_fleet, overview

SCHEME, KIND = "home://", "application/json"
MAX_LISTED = 1000  # homes in the list of resources; the others can be read by name


class AnyFleetResult(BaseModel):
    """The answer over all homes, and of how many homes it is so."""

    text: str
    has: int
    has_none: int
    cannot_tell: int


FleetResult = Annotated[CallToolResult, AnyFleetResult]


async def listed_homes(ops: Operations) -> list[Resource]:
    """The homes that the request may see."""
    names = await anyio.to_thread.run_sync(lambda: ops.homes.names)
    return [Resource(uri=f"{SCHEME}{name}", name=name, mime_type=KIND) for name in names[:MAX_LISTED]]


def add_homes(server: MCPServer, ops: Operations, call: Callable[..., CallToolResult]) -> None:
    """Add the resource of a home, and the tool for a fleet; ``call`` makes an operation's values a tool's result."""

    def read(home: str) -> str:
        try:
            return json.dumps(overview(ops, home), ensure_ascii=False)
        except CartierError as error:
            raise ResourceError(str(error)) from error

    about = "A home by its name: rooms, how many objects of each label, notes"
    server.resource(f"{SCHEME}{{+home}}", name="home", description=about, mime_type=KIND)(read)
    if ops.homes.fleet is None:
        return

    def ask_homes(words: Annotated[str, Field(description="'which homes have no sofa?'")]) -> FleetResult:
        return call(lambda: _counted(ask_fleet(ops, words)))

    says = "Over all homes: which have or lack something, how many, most, biggest"
    server.add_tool(ask_homes, description=says, annotations=ToolAnnotations(read_only_hint=True))


def _counted(answer: dict[str, Any]) -> dict[str, Any]:
    """An answer over all homes, short enough for a model."""
    return {"text": answer["text"]} | {key: len(answer[key]) for key in ("has", "has_none", "cannot_tell")}
