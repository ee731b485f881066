"""Option groups: what several commands take together is written once, and becomes what they need of it."""

from __future__ import annotations

import functools
import inspect
from collections.abc import Callable, Sequence
from dataclasses import dataclass, fields, is_dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, get_type_hints

import typer

from cartier.cli.common import Blur, ModelName, VisionName

if TYPE_CHECKING:
    from cartier.io.command import OwnerCommand
    from cartier.serving.homes import Homes
    from cartier.serving.operations import Operations
    from cartier.types import CandidateView, VisualQuestion
    from cartier.vision.permission import Look

TOKENS = "A file with a token a line, and the homes that it may see if not all. Default: the token CARTIER_TOKEN."


@dataclass(frozen=True)
class Answering:
    """Who answers, and what an emergency sets off."""

    reasoner: Annotated[
        str, typer.Option(help="auto (the configured language model, else embedded), or any of 'cartier list'.")
    ] = "auto"
    model: ModelName = None
    emergency_number: Annotated[
        str | None,
        typer.Option(metavar="NUMBER", help="What to call in an emergency. Default: by the country of the locale."),
    ] = None
    on_alarm: Annotated[
        str | None,
        typer.Option(
            metavar="COMMAND", help="Run this if words tell of harm or an emergency; the answer is its input."
        ),
    ] = None

    @property
    def alarm_command(self) -> OwnerCommand | None:
        from cartier.io.command import OwnerCommand

        return OwnerCommand(self.on_alarm, "--on-alarm") if self.on_alarm is not None else None

    def operations(self, homes: Callable[[], Homes], look: Look | None = None) -> Operations:
        """The operations on some homes, which are opened when the command for alarms is known to be one."""
        from cartier import specs
        from cartier.serving.operations import Operations

        told = self.alarm_command
        return Operations(
            homes(), specs.reasoner(self.reasoner, model=self.model), emergency_number=self.emergency_number,
            on_alarm=None if told is None else told.run, look=look,
        )  # fmt: skip


@dataclass(frozen=True)
class Looking:
    """Whether a vision model may see photographs, and which."""

    look: Annotated[
        str,
        typer.Option("--look", help="Ask a vision model about photographs: never, ask (you agree each time), or auto."),
    ] = "never"
    vision: VisionName = "openai"
    blur: Blur = False

    def allowed(
        self, consent: Callable[[VisualQuestion, Sequence[CandidateView]], bool] | None = None, **options: Any
    ) -> Look | None:
        from cartier import specs

        return specs.look(self.look, self.vision, consent, self.blur, **options)


@dataclass(frozen=True)
class Listening:
    """Where a server listens, and to whom."""

    host: Annotated[str, typer.Option(help="The address to listen on; any but a loopback address needs a token.")] = (
        "127.0.0.1"
    )
    name: Annotated[list[str] | None, typer.Option("--name", help="Another host name of this server.")] = None
    token_file: Annotated[Path | None, typer.Option(help=TOKENS)] = None
    tls_cert: Annotated[Path | None, typer.Option(help="TLS certificate (PEM); needs --tls-key.")] = None
    tls_key: Annotated[Path | None, typer.Option(help="TLS private key (PEM).")] = None


def grouped(command: Callable[..., None]) -> Callable[..., None]:
    """Replace each parameter of a command that is a group, a dataclass of options, by these options."""
    parameters, groups = list[inspect.Parameter](), dict[str, Any]()
    hints = get_type_hints(command, include_extras=True)
    for own in inspect.signature(command).parameters.values():
        kind = hints[own.name]
        if not is_dataclass(kind):
            parameters.append(own.replace(kind=own.KEYWORD_ONLY, annotation=kind))
            continue
        groups[own.name], of = kind, get_type_hints(kind, include_extras=True)
        option = own.replace(kind=own.KEYWORD_ONLY)
        parameters += [option.replace(name=f.name, default=f.default, annotation=of[f.name]) for f in fields(kind)]

    @functools.wraps(command)
    def flat(**given: Any) -> None:
        made = {name: kind(**{f.name: given.pop(f.name) for f in fields(kind)}) for name, kind in groups.items()}
        command(**made, **given)

    flat.__signature__ = inspect.Signature(parameters)  # type: ignore[attr-defined]
    flat.__annotations__ = {option.name: option.annotation for option in parameters}
    return flat
