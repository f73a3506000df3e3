"""Settings: what there is, how they are composed, and the checks. Imports no JAX."""

from lanewise.config.composition import (
    compose,
    differences,
    digest,
    dump_toml,
    field_types,
    first_difference,
    flatten,
    load_toml,
    replace,
)

__all__ = [
    "compose",
    "differences",
    "digest",
    "dump_toml",
    "field_types",
    "first_difference",
    "flatten",
    "load_toml",
    "replace",
]
