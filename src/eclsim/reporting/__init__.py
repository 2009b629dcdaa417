"""Output for readers, shared by all topics: figures and their style, the schematic, HTML pages, numbers."""
