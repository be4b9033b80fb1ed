"""Endpoints for tokens and the audit log."""
