"""Statics of one particle between two plates, and of single contacts: no inertia and no time."""
