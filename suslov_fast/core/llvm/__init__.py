"""Lists of operations as machine code: LLVM's text, its compiler, and loops over any list."""
