"""Who may do what: tokens, their scopes, and the audit log."""
