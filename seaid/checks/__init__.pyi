from .check import Code as Code
from .check import Observation as Observation
from .check import observed as observed
from .codes import CODES as CODES
