"""Signatures that numba found once: the same code and the same errors, looked for no more."""

import math
import operator

import numba
import numpy as np
import pytest
from numba.core import event
from numba.core.compiler import Flags
from numba.core.targetconfig import ConfigStack
from numba.extending import overload

from twin.compiled import signatures
from twin.compiled.folder import OURS

OWN = numba.types.Function.get_call_type
"""numba's, when nothing compiles"""


def ours(function, **options):
    """A function that numba takes for one of ours, kept nowhere."""
    made = numba.njit(**options)(function)
    setattr(made, OURS, True)
    return made


def test_what_was_found_is_not_looked_for_again(monkeypatch):
    looked = []
    find = signatures._find

    def finding(kind, context, args, kws):
        looked.append((kind.typing_key, args))
        return find(kind, context, args, kws)

    monkeypatch.setattr(signatures, "_find", finding)
    monkeypatch.setattr(signatures, "_found", {})

    def sums():
        return ours(lambda a, b: (a + b) * (a + b) + (b + a))

    assert sums()(1.5, 2.0) == 15.75
    assert looked
    assert len(looked) == len(set(looked))  # each once, typed and written
    count = len(looked)
    assert sums()(1.5, 2.0) == 15.75
    assert len(looked) == count
    assert sums()(1, 2) == 12  # other types are
    assert len(looked) > count


def test_each_caller_gets_what_was_made_for_its_options():
    def ratio(a, b):
        raise NotImplementedError

    @overload(ratio)
    def _ratio(a, b):
        return lambda a, b: a / b

    def callers(error_model):
        one = ours(lambda a, b: ratio(a, b), error_model=error_model)
        other = ours(lambda a, b: ratio(a, b) + 0.0, error_model=error_model)
        return one, other

    for quiet, loud in zip(callers("numpy"), callers("python"), strict=True):
        assert quiet(1.0, 0.0) == math.inf
        with pytest.raises(ZeroDivisionError):
            loud(1.0, 0.0)


def test_what_failed_is_looked_for_again():
    def late(x):
        raise NotImplementedError

    with pytest.raises(numba.TypingError):
        ours(lambda x: late(x))(1.0)

    @overload(late)
    def _of_floats(x):
        return (lambda x: 2.0 * x) if isinstance(x, numba.types.Float) else None

    assert ours(lambda x: late(x))(1.5) == 3.0
    with pytest.raises(numba.TypingError, match="late"):
        ours(lambda x: late(x))(1)

    @overload(late)
    def _of_integers(x):
        return (lambda x: 3 * x) if isinstance(x, numba.types.Integer) else None

    assert ours(lambda x: late(x))(2) == 6
    assert ours(lambda x: late(x))(1.5) == 3.0


def test_what_numba_learns_later_counts_at_once():
    def size(x):
        raise NotImplementedError

    @overload(size)
    def _of_numbers(x):
        return (lambda x: 1.0) if isinstance(x, numba.types.Number) else None

    both = (ours, numba.njit)
    assert [make(lambda x: size(x))(1.5) for make in both] == [1.0, 1.0]

    @overload(size)
    def _of_floats(x):
        return (lambda x: 2.0) if isinstance(x, numba.types.Float) else None

    @overload(size)
    def _of_arrays(x):
        return (lambda x: 1.0 * x.size) if isinstance(x, numba.types.Array) else None

    @overload(operator.sub)
    def _minus(x, y):
        return (lambda x, y: 9.0) if (x, y) == (numba.types.boolean, numba.types.float64) else None

    alone = numba.njit(lambda x: size(x))(1.5)  # which of both is for numba to say
    for make in both:
        assert make(lambda x: size(x) + size(1.5))(1.5) == 2.0 * alone
        assert make(lambda x: size(x))(np.zeros(3)) == 3.0
    minus = [make(lambda x, y: x - y)(True, 0.5) for make in both]
    assert minus[0] == minus[1]


def test_numba_is_itself_for_the_functions_of_others():
    seen = []

    class Listener(event.Listener):
        def on_start(self, event):
            seen.append(numba.types.Function.get_call_type is OWN)

        def on_end(self, event):
            pass

    def asked(make):
        seen.clear()
        assert make(lambda x: x + 1.0)(2.0) == 3.0
        return list(seen)

    with event.install_listener("numba:compile", Listener()):
        assert asked(numba.njit) == [True]
        assert asked(ours) == [not signatures.usable()]
    assert numba.types.Function.get_call_type is OWN
    assert "get_call_type" not in vars(numba.types.Function)


def without_name(monkeypatch):
    monkeypatch.setattr(signatures, "OPTIONS", (*signatures.OPTIONS, "an option of another numba"))


def without_stack(monkeypatch):
    monkeypatch.delattr(ConfigStack, "top_or_none")


def without_option(monkeypatch):
    monkeypatch.delattr(Flags, "forceinline")


def with_other_parameters(monkeypatch):
    def find(self, context, args, kws, more=None):
        return OWN(self, context, args, kws)

    monkeypatch.setattr(numba.types.Function, "get_call_type", find)


def without_keys(monkeypatch):
    def make(template):
        raise AttributeError("_impl_keys")

    monkeypatch.setattr(signatures.types, "Function", make)


@pytest.mark.parametrize(
    "change", [without_name, without_stack, without_option, with_other_parameters, without_keys]
)
def test_a_numba_that_is_made_in_another_way_is_left_alone(monkeypatch, change):
    signatures.usable.cache_clear()
    with monkeypatch.context() as patch:
        change(patch)
        assert not signatures.usable()
        before = numba.types.Function
        signatures.begin()
        assert numba.types.Function is before
        assert getattr(before, "get_call_type", None) is not signatures.remembered
        signatures.end()
    signatures.usable.cache_clear()
    assert signatures.usable()


def test_without_them_all_compiles_to_the_same(monkeypatch):
    def text(make):
        return make(lambda a, b: (a + b) / (a - b) + math.sqrt(a))

    found = text(ours)(3.0, 2.0)
    monkeypatch.setattr(signatures, "usable", lambda: False)
    assert text(ours)(3.0, 2.0) == found
    assert numba.types.Function.get_call_type is OWN
