from .mjcf import WrittenMjcf as WrittenMjcf
from .mjcf import write_mjcf as write_mjcf
from .parameters import content_of as content_of
from .parameters import parameters_content as parameters_content
from .parameters import read_parameters as read_parameters
from .urdf import write_urdf as write_urdf
