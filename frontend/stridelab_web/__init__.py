"""Pages and viewer of stridelab; they use the backend over HTTP only."""
