"""Numba's compiler in less time, to the same code: it is asked less often for what it has answered.

A kernel is compiled with `Quick` by Numba's own option for that: nothing in Numba is changed, nor in what else it
compiles. It leans on Numba's inside, so it is used with the versions that it was tried with (`kernels.QUICK`) alone.
"""

import operator
from functools import cache
from typing import Any

from numba.core.compiler import Compiler, Flags
from numba.core.compiler_machinery import PassManager
from numba.core.datamodel.models import OpaqueModel
from numba.core.typed_passes import NopythonRewrites
from numba.core.types import Function
from numba.core.typing.context import Context
from numba.core.untyped_passes import InlineClosureLikes, LiteralUnroll, MakeFunctionToJitFunction, WithLifting
from numba.extending import register_model

# what has nothing to do where there is no closure, no `with` and no sum of whole arrays
_LEFT_OUT = {WithLifting, InlineClosureLikes, MakeFunctionToJitFunction, LiteralUnroll, NopythonRewrites}
# what says nothing of the functions that a function calls: those of Numba's are compiled once for all of ours
_OWN = {"no_cpython_wrapper", "no_cfunc_wrapper", "release_gil", "forceinline", "inline", "dbg_optnone", "fastmath"}
_OPERATORS = {getattr(operator, name) for name in operator.__all__}


class Quick(Compiler):
    """Numba's compiler for kernels: scalar code without closures."""

    def __init__(self, typing: Context, target: Any, library: Any, args: Any, result: Any, flags: Flags, named: Any):
        unsettled = _Unsettled(flags)  # type: ignore[no-untyped-call]
        super().__init__(typing, target, library, args, result, unsettled, named)  # type: ignore[no-untyped-call]
        self.state.typingctx = self.state.targetctx.typing_context = _meanings(typing)

    def define_pipelines(self) -> list[PassManager]:
        """Numba's passes, but for those that have nothing to do here: each looks at every line several times."""
        [usual] = super().define_pipelines()  # type: ignore[no-untyped-call]
        quick = PassManager(usual.pipeline_name)
        quick.passes = [(each, name) for each, name in usual.passes if each not in _LEFT_OUT]
        quick.finalize()
        return [quick]


class _Settled(Flags):
    """How a function is compiled, from when that has begun: there is one of each, and it changes no more.

    Numba looks with it, many times a line, for what an operation means. Its own flags are compared by all their values.
    """

    __slots__ = ("_hash",)

    def __init__(self, flags: Flags) -> None:
        super().__init__(flags)  # type: ignore[no-untyped-call]
        self._hash = hash(flags)

    def __hash__(self) -> int:
        return self._hash

    def __eq__(self, other: object) -> bool:
        same = self is other
        return same if isinstance(other, _Settled) else bool(super().__eq__(other))  # type: ignore[no-untyped-call]


class _Unsettled(Flags):
    """How a function is to be compiled; what Numba copies when it begins is `_Settled`."""

    __slots__ = ()

    def copy(self) -> _Settled:
        plain = Flags(self)
        for name in _OWN & Flags.options.keys():
            plain.discard(name)
        return _settled.setdefault(repr(plain), _Settled(plain))


_settled: dict[str, _Settled] = {}


class _Operation(Function):
    """An operator as Numba knows it, that remembers what it means for arguments of some types.

    Otherwise every meaning that it has, of strings and sets and dates, is tried anew wherever it is written. What is
    compiled from Python is not remembered: that depends on how its caller is compiled.
    """

    def __init__(self, templates: Any) -> None:
        super().__init__(templates)
        self._known: dict[Any, Any] = {}

    def get_call_type(self, context: Any, args: Any, kws: Any) -> Any:
        found = self._known.get(args) if not kws else None
        if found is None:
            found = super().get_call_type(context, args, kws)
            if found is not None and not kws and self.get_impl_key(found) is self.typing_key:
                self._known[args] = found
        return found


register_model(_Operation)(OpaqueModel)  # in a kernel it may have a name, like any function


class _Meanings(Context):
    """What Numba knows of types, shared with all it compiles otherwise; operators are `_Operation`."""

    def __init__(self, shared: Context) -> None:
        self.__dict__ = vars(shared)

    def resolve_value_type(self, val: Any) -> Any:
        """The type of a constant, a function or an operator."""
        found = super().resolve_value_type(val)  # type: ignore[no-untyped-call]
        return _operation(found) if type(found) is Function and found.typing_key in _OPERATORS else found


@cache
def _operation(known: Function) -> _Operation:
    return _Operation(known.templates)


@cache
def _meanings(shared: Context) -> _Meanings:
    return _Meanings(shared)
