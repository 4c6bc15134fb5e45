"""Formulas: functions of scalars without loops, memory or threads."""
