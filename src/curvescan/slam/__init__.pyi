from .config import SlamConfig as SlamConfig
from .localizer import Localizer as Localizer
from .loops.audit import Contradiction as Contradiction
from .loops.closures import Closure as Closure
from .loops.closures import ClosureOutcome as ClosureOutcome
from .map import SlamMap as SlamMap
from .map import load_map as load_map
from .slam import Slam as Slam
