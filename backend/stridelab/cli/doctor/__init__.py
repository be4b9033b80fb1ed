"""``stridelab doctor``: what the service needs, and what a running one lacks."""
