"""What all topics share to be read: figures and their style, the schematic, HTML pages, JSON."""
