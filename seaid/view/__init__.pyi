from .playback import Shown as Shown
from .window import View as View
from .window import view_robot as view_robot
