"""Public names of the package, lent when asked for: the page docs/api.md explains them."""

from recorder.devices.registry import DEVICES as DEVICES
from recorder.doctor import examine as examine
from recorder.drive.record import RecordConfig as RecordConfig
from recorder.drive.record import RecordResult as RecordResult
from recorder.drive.record import record as record
from recorder.episode.edit import cut_episode as cut_episode
from recorder.episode.edit import drop_actors as drop_actors
from recorder.episode.edit import join_episodes as join_episodes
from recorder.episode.edit import thin_actors as thin_actors
from recorder.evaluation.trajectory_files import read_tum as read_tum
from recorder.evaluation.trajectory_files import write_tum as write_tum
from recorder.replaying.replay import ReplayConfig as ReplayConfig
from recorder.replaying.replay import ReplayOptions as ReplayOptions
from recorder.replaying.replay import ReplayResult as ReplayResult
from recorder.replaying.replay import replay as replay
from recorder.slam.bag_odometry import run_odometry as run_odometry
from recorder.writers.base import Encoder as Encoder
from recorder.writers.base import Writer as Writer
from recorder.writers.ros.rosbag1 import Ros1Encoder as Ros1Encoder
from recorder.writers.ros.rosbag1 import Rosbag1Writer as Rosbag1Writer
from recorder.writers.topics import PROFILES as PROFILES
from recorder.writers.topics import TopicProfile as TopicProfile
from recorder.writers.topics import TopicRule as TopicRule
