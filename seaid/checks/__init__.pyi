from .codes import CODES as CODES
from .codes import Code as Code
