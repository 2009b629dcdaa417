"""User input: fields with unit and range, numbers as written, files, and the mistakes found in them."""
