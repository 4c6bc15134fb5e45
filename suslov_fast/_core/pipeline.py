"""How Numba compiles a loop: whole, and what it is made of only as far as the loop needs it.

Numba optimises every function and makes machine code of it, and then again as a piece of each
function that calls it. That was half of the time of a first call, for only loops are ever called.
"""

import gc
from contextlib import contextmanager

from numba.core import codegen, compiler


class _Ingredient(codegen.JITCodeLibrary):
    """The code of one function as its callers take it in: simplified, and nothing else."""

    def _optimize_functions(self, ll_module):
        ll_module.data_layout = self._codegen._data_layout
        for function in ll_module.functions:
            if not function.is_declaration:
                # A count of a reference must meet its counterpart here: callers hide it.
                passes, builder = self._codegen._function_pass_manager(opt=1)
                passes.run(function, builder)

    def _optimize_final_module(self):
        pass

    def _finalize_final_module(self):
        self._finalize_dynamic_globals()
        self._finalized = True

    def get_pointer_to_function(self, name):
        return 0

    @property
    def codegen(self):
        """Itself: where there is no machine code, there is no environment to set."""
        return self

    def set_env(self, env_name, env):
        pass


class _Whole(codegen.JITCodeLibrary):
    """The code of a loop with all that it calls: optimised once, as it is complete.

    Numba optimises each function first, and then whatever brings references of arrays together.
    """

    def _optimize_functions(self, ll_module):
        ll_module.data_layout = self._codegen._data_layout

    def _optimize_final_module(self):
        passes, builder = self._codegen._module_pass_manager()
        passes.run(self._final_module, builder)


# Numbas whose passes are run in another way compile all of them as any function.
KNOWN = hasattr(codegen.CPUCodegen, "_pass_builder")


class Loops(compiler.Compiler):
    """Numba's compiler, for what Python calls."""

    def compile_extra(self, func):
        generator = self.state.targetctx.codegen()
        name = func.__qualname__
        library = _Whole(generator, name) if KNOWN else generator.create_library(name)
        self.state.library = library
        self.state.library.enable_object_caching()
        with _uncollected(), _ingredients_only(generator):
            return super().compile_extra(func)


@contextmanager
def _ingredients_only(generator):
    """All that is compiled meanwhile, what Numba itself brings too, becomes part of another."""
    if KNOWN:
        generator._library_class = _Ingredient
    try:
        yield
    finally:
        generator.__dict__.pop("_library_class", None)


@contextmanager
def _uncollected():
    """No search for garbage: the compiler makes little, and a sixth of its time went there."""
    collecting = gc.isenabled()
    gc.disable()
    try:
        yield
    finally:
        if collecting:
            gc.enable()
