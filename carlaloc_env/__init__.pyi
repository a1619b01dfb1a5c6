"""Public names of the package, lent when asked for: the page docs/api.md explains them."""

from carlaloc_env.driving.driving_world import DrivingWorld as DrivingWorld
from carlaloc_env.samples import CanState as CanState
from carlaloc_env.samples import DepthImage as DepthImage
from carlaloc_env.samples import Events as Events
from carlaloc_env.samples import FlowImage as FlowImage
from carlaloc_env.samples import GnssFix as GnssFix
from carlaloc_env.samples import Image as Image
from carlaloc_env.samples import Imu as Imu
from carlaloc_env.samples import NormalImage as NormalImage
from carlaloc_env.samples import ObjectList as ObjectList
from carlaloc_env.samples import Odometry as Odometry
from carlaloc_env.samples import PointCloud as PointCloud
from carlaloc_env.samples import RadarScan as RadarScan
from carlaloc_env.samples import Sample as Sample
from carlaloc_env.samples import SemanticImage as SemanticImage
from carlaloc_env.samples import Speed as Speed
from carlaloc_env.samples import WheelTicks as WheelTicks
from carlaloc_env.sensor_stage import SensorStage as SensorStage
from carlaloc_env.sensors.registry import SENSOR_KINDS as SENSOR_KINDS
from carlaloc_env.town.build import load_town as load_town
from carlaloc_env.town.sources import TownId as TownId
from carlaloc_env.town.sources import identify_town as identify_town
from carlaloc_env.town.sources import known_towns as known_towns
from carlaloc_env.weather.schedule import WeatherSchedule as WeatherSchedule

__version__: str
TOWNS: tuple[str, ...]
