"""From an archive with the description of a humanoid to a proposed card."""
