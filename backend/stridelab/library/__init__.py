"""Public Python API; ``import stridelab as sl`` exports its names."""
