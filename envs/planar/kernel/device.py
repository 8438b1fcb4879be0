"""Functions, structures and arrays of the kernel, in short."""

import typing

import warp as wp

Floats = wp.array(dtype=float)
Vec2s, Vec3s = wp.array(dtype=wp.vec2), wp.array(dtype=wp.vec3)


def no_type_check(made: typing.Any) -> typing.Any:
    """A Warp function, or of a class a structure. By this name jaxtyping's import hook knows what
    it must leave as it is."""
    kind = wp.struct if isinstance(made, type) else wp.func
    return kind(typing.no_type_check(made))
