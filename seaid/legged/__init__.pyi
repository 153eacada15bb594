from .base import whole_body as whole_body
from .contacts import ContactForces as ContactForces
from .extension import LeggedValidation as LeggedValidation
from .feet import find_contacts as find_contacts
from .feet import with_leg_order as with_leg_order
from .floating import FloatingRobot as FloatingRobot
from .loading import load_robot as load_robot
