"""Infused drugs: what a dose does to heart, vessels and veins."""
