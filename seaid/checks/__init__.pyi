from .codes import CODES as CODES
from .codes import Code as Code
from .verdict import JointCheck as JointCheck
from .verdict import JointFit as JointFit
from .verdict import Verdict as Verdict
