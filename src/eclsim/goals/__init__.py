"""Find the smallest device settings with which outputs reach goals."""
