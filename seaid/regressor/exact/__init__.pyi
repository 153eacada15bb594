from .base import base_parameters as base_parameters
from .codegen import export_c as export_c
from .codegen import export_numpy as export_numpy
from .form import CompleteModel as CompleteModel
from .form import RigidBodyForm as RigidBodyForm
from .form import complete_model as complete_model
from .form import rigid_body as rigid_body
from .grouping import ExactBaseParameters as ExactBaseParameters
