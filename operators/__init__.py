"""Operators: they read the context, call the engine and report."""
