"""The docstring below each field of a dataclass: the one source of help texts and settings.md."""

import ast
import dataclasses
import inspect
import textwrap
from functools import cache
from itertools import pairwise


@cache
def of_fields(owner: type) -> dict[str, str]:
    """The docstring of each field by its name, on one line; fields of base classes first."""
    docs: dict[str, str] = {}
    for part in filter(dataclasses.is_dataclass, reversed(owner.__mro__)):
        (definition,) = ast.parse(textwrap.dedent(inspect.getsource(part))).body
        body = definition.body if isinstance(definition, ast.ClassDef) else []
        for field, doc in pairwise(body):
            if isinstance(field, ast.AnnAssign) and isinstance(field.target, ast.Name):
                match doc:
                    case ast.Expr(value=ast.Constant(value=str(text))):
                        docs[field.target.id] = " ".join(text.split())
    return docs
