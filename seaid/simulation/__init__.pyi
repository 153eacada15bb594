from .plant import mass_matrix as mass_matrix
from .replaying import replay as replay
from .simulation import Noise as Noise
from .simulation import simulate as simulate
