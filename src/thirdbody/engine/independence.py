"""Whether the bodies of a run influence each other."""

from thirdbody.engine.state import State


def coupling(state: State, explicit: bool) -> str:
    """Return why the bodies of a run influence each other, as a clause; empty where they do not."""
    upper = state.world.upper
    if state.world.debris_meets:
        return 'its bodies may meet each other (contact.debris_contact = "none" declares that they do not)'
    if upper is None or state.n_bodies == 1:
        return ""
    if upper.foundation is not None:
        shared = explicit or upper.foundation.free
        return "all bodies carry the plate of one foundation together" if shared else ""
    if upper.free and len(upper.heights) == 1:
        return 'all bodies carry one plate together (plates.upper.support = "load_per_particle", or plates.upper.gap, would not)'
    return ""
