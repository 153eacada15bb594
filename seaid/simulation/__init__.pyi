from .replaying import ReplayComparison as ReplayComparison
from .replaying import compare_replays as compare_replays
from .replaying import replay as replay
from .simulation import Noise as Noise
from .simulation import simulate as simulate
