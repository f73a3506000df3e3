"""The docstring below each field of a dataclass: the one source of help texts and settings.md."""

import ast
import dataclasses
import inspect
import sys
from functools import cache
from itertools import pairwise


@cache
def of_fields(owner: type) -> dict[str, str]:
    """The docstring of each field by its name, on one line; fields of base classes first."""
    docs: dict[str, str] = {}
    for part in filter(dataclasses.is_dataclass, reversed(owner.__mro__)):
        for field, doc in pairwise(_classes(part.__module__)[part.__name__].body):
            if isinstance(field, ast.AnnAssign) and isinstance(field.target, ast.Name):
                match doc:
                    case ast.Expr(value=ast.Constant(value=str(text))):
                        docs[field.target.id] = " ".join(text.split())
    return docs


@cache
def _classes(module: str) -> dict[str, ast.ClassDef]:
    """The classes at the top of a module's source, by name."""
    tree = ast.parse(inspect.getsource(sys.modules[module]))
    return {node.name: node for node in tree.body if isinstance(node, ast.ClassDef)}
