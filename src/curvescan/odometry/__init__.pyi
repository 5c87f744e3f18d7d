from .config import KeyframesConfig as KeyframesConfig
from .config import MotionConfig as MotionConfig
from .config import OdometryConfig as OdometryConfig
from .odometry import Odometry as Odometry
from .step import Step as Step
from .step import StepOutcome as StepOutcome
