"""Reaction times, which the pupil of examples 11 to 13 does not learn."""

from learning.town01_route import Ride

REACTION = 12
"""Actions before a standing driver starts; a pupil without memory cannot learn such a delay."""


def without_reactions(ride: Ride) -> Ride:
    """The ride without the actions of a driver who stands and is about to start."""
    waits = (ride.seen[:, 0] < 0.0025) & (ride.taught[:, 1] < 0.0)
    goes = [bool((ride.taught[k + 1 : k + 1 + REACTION, 1] > 0.0).any()) for k in range(len(waits))]
    keep = ~(waits & goes)
    return ride._replace(seen=ride.seen[keep], taught=ride.taught[keep])
