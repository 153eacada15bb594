from .codegen import export_c as export_c
from .codegen import export_numpy as export_numpy
from .equations import CompleteModel as CompleteModel
from .equations import RigidBodyForm as RigidBodyForm
from .equations import base_parameters as base_parameters
from .equations import complete_model as complete_model
from .equations import rigid_body as rigid_body
from .grouping import ExactBaseParameters as ExactBaseParameters
