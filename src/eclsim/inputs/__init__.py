"""Input from outside: fields with unit and range, numbers as written, files, and mistakes in them."""
