"""The patient: circulations as tables, size and blood volume."""
