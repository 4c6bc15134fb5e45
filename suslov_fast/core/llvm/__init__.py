"""Expression programs as machine code: LLVM's text, its compiler, and sparse elimination."""
