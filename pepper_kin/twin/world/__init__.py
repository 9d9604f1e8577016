"""Contacts of a robot and of free bodies with each other and with a scene.

    World, FreeBody                           boxes and spheres that move; give it to `Twin(world=...)`
    WorldContact, StepSolution, ContactError

A world is given to a twin, or steps by itself with `World.advance_alone`.
"""

from pepper_kin.call_errors import name_options
from pepper_kin.twin.contact_error import ContactError
from pepper_kin.twin.world.contact import StepSolution, WorldContact
from pepper_kin.twin.world.free_body import FreeBody
from pepper_kin.twin.world.world import World

__all__ = ["ContactError", "FreeBody", "StepSolution", "World", "WorldContact"]

name_options(__name__)
