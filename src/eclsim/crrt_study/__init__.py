"""The combined ECMO and CRRT study: every way to connect the CRRT, with figures, report and files."""
