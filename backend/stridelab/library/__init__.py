"""The public front of the library; ``import stridelab as sl`` exports its names."""
