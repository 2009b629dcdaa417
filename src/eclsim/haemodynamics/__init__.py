"""What clinicians read: pressures, flows, volumes, work and limits of a steady beat.

The front doors are `simulate` (module `dataset`, one patient), `batch_outputs` (module `evaluation`, many)
and `output_derivatives` (module `derivatives`).
"""
