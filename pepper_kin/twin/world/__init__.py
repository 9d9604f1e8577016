"""Contacts of a robot and of free bodies with one another and with a scene."""

from pepper_kin.twin.world.free_body import FreeBody
from pepper_kin.twin.world.step import StepSolution
from pepper_kin.twin.world.world import ContactError, World, WorldContact

__all__ = ["ContactError", "FreeBody", "StepSolution", "World", "WorldContact"]
