"""Sections 4.2 and 4.5: motion of the centre of mass over a contact sequence by optimal control."""
