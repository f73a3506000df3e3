"""Writes ``--help`` with tyro, from the same dataclasses that hold the settings.

A field's help is the docstring below it, followed by its range.
"""

import dataclasses
import inspect
import warnings
from collections.abc import Mapping
from functools import cache
from typing import Annotated, Any, Literal, Union, get_args, get_origin, get_type_hints

import tyro
from tyro.constructors import (
    ConstructorRegistry,
    StructConstructorSpec,
    StructFieldSpec,
    StructTypeInfo,
)

from lanewise.commands import docstrings
from lanewise.commands.arguments import without_none
from lanewise.ranges import Between, Kind, OneOf

_MARKERS = (tyro.conf.FlagConversionOff,)


def show_all(commands: Mapping[str, type], description: str) -> None:
    """Prints the help of ``lanewise`` itself."""
    choices = tuple(
        Annotated[command, tyro.conf.subcommand(name)] for name, command in commands.items()
    )
    _show(Union[choices], "lanewise", description)  # noqa: UP007  (the members are known at run time only)


def show_one(name: str, command: type) -> None:
    """Prints the help of one command, with every setting it takes."""
    _show(command, f"lanewise {name}", inspect.getdoc(command))


def _show(target: Any, program: str, description: str | None) -> None:
    warnings.filterwarnings("ignore", category=UserWarning, module="tyro")
    try:
        tyro.cli(
            target,
            prog=program,
            description=description,
            args=["--help"],
            config=_MARKERS,
            registry=_registry(),
        )
    except SystemExit:
        # tyro ends the process after printing; the caller decides about that.
        return


@cache
def _registry() -> ConstructorRegistry:
    registry = ConstructorRegistry()
    registry.struct_rule(_describe)
    return registry


def _describe(info: StructTypeInfo) -> StructConstructorSpec | None:
    """Describes one of our dataclasses to tyro, with ranges in the help texts."""
    # tyro has dataclasses of its own, which it must describe itself.
    if not dataclasses.is_dataclass(info.type) or not info.type.__module__.startswith("lanewise."):
        return None
    default = info.default if isinstance(info.default, info.type) else None
    docs, hints = docstrings.of_fields(info.type), get_type_hints(info.type, include_extras=True)
    fields = tuple(
        StructFieldSpec(
            name=item.name,
            type=_annotate(hints[item.name], item.metadata),
            default=_default(item) if default is None else getattr(default, item.name),
            helptext=_help(docs.get(item.name, ""), hints[item.name]),
        )
        for item in dataclasses.fields(info.type)
    )
    return StructConstructorSpec(instantiate=info.type, fields=fields)


def _default(item: "dataclasses.Field[Any]") -> Any:
    if item.default is not dataclasses.MISSING:
        return item.default
    if item.default_factory is not dataclasses.MISSING:
        return item.default_factory()
    return tyro.MISSING


def _annotate(annotation: Any, metadata: Mapping[str, Any]) -> Any:
    """Adds to a type what tyro should know: its choices, a short flag, being positional."""
    plain = without_none(annotation)
    if plain is not annotation:
        # tyro would offer a word None, which we do not read: such an option is just left out.
        bound = _bound(plain)
        metavar = Kind.of(plain).type.__name__.upper()
        if isinstance(bound, OneOf):
            metavar = "{" + ",".join(bound.names) + "}"
        return Annotated[annotation, tyro.conf.arg(metavar=metavar)]
    bound = _bound(annotation)
    if isinstance(bound, OneOf):
        annotation = Literal[bound.names]
    if dataclasses.is_dataclass(annotation) and metadata.get("inline"):
        return Annotated[annotation, tyro.conf.arg(name="")]
    if metadata.get("positional"):
        return _positional(annotation)
    if annotation is bool and metadata.get("switch"):
        return Annotated[annotation, tyro.conf.arg(metavar="")]
    if "short" in metadata:
        return Annotated[annotation, tyro.conf.arg(aliases=(metadata["short"],))]
    return annotation


def _positional(annotation: Any) -> Any:
    """A positional; a list is shown as one word and more, as tyro would call it optional."""
    if get_origin(annotation) is not tuple:
        return tyro.conf.Positional[annotation]  # type: ignore[misc]
    member = get_args(annotation)[0]
    word = member.__name__.upper()
    named = tyro.conf.arg(metavar=f"{word} [{word} ...]")
    return Annotated[tyro.conf.Positional[member], named]  # type: ignore[misc,valid-type]


def _bound(annotation: Any) -> Between | OneOf | None:
    metadata = get_args(annotation)[1:] if get_origin(annotation) is Annotated else ()
    return next((item for item in metadata if isinstance(item, Between | OneOf)), None)


def _help(doc: str, annotation: Any) -> str:
    bound = _bound(without_none(annotation))
    return f"{doc} [{bound}]" if isinstance(bound, Between) else doc
