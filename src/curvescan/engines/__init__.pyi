from .record import RunRecord as RunRecord
from .run import run_engine as run_engine
