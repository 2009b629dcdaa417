"""One case or one varied key: steady beat, course in time, sweep, with their tables, figures and files."""
