"""Compiled functions, kept between processes under a hash of everything they are made from.

`jit` compiles a function at its first call, `cfunc` makes a C callback, and `dispatch` makes one
function from a table of types. None of them loads numba before something is compiled.
"""

import os

# numba formats and colours an error for most things it tries; colouring is 4 % of compile time
os.environ.setdefault("NUMBA_DISABLE_ERROR_MESSAGE_HIGHLIGHTING", "1")

from twin.compiled.content import changed as changed
from twin.compiled.content import generation as generation
from twin.compiled.function import Compiled as Compiled
from twin.compiled.function import Written as Written
from twin.compiled.function import borrowing as borrowing
from twin.compiled.function import cfunc as cfunc
from twin.compiled.function import dispatch as dispatch
from twin.compiled.function import generate as generate
from twin.compiled.function import inline as inline
from twin.compiled.function import jit as jit
