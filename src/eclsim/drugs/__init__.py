"""Infused drugs: effects of a dose on heart, vessels and veins."""
