"""Authorisation: tokens, their scopes, and the audit log."""
