"""The paper's tables and plots, made anew on objects that kfit draws itself; see ``kfit bench paper``."""
