"""The exact equations of robots, of `seaid.regressor.exact`, under the names that scripts use."""

from seaid.regressor import exact

CompleteModel = exact.CompleteModel
ExactBaseParameters = exact.ExactBaseParameters
RigidBodyForm = exact.RigidBodyForm
base_parameters = exact.base_parameters
complete_model = exact.complete_model
export_c = exact.export_c
export_numpy = exact.export_numpy
rigid_body = exact.rigid_body
