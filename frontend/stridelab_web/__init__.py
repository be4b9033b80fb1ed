"""Pages and viewer of stridelab. Knows the backend by HTTP only."""
