from .card import EffectorCard as EffectorCard
from .card import robot_card as robot_card
from .card import robot_names as robot_names
from .configuration_sampling import UniformConfigurations as UniformConfigurations
from .configuration_sampling import uniform_configurations as uniform_configurations
from .inverse_kinematics import stand as stand
from .loader import load_robot as load_robot
from .robot import Effector as Effector
from .robot import Robot as Robot
from .self_collision import SelfCollision as SelfCollision
from .visuals import LinkMesh as LinkMesh
from .visuals import link_meshes as link_meshes
from .visuals import link_poses as link_poses

__all__ = [
    "Effector",
    "EffectorCard",
    "LinkMesh",
    "Robot",
    "SelfCollision",
    "UniformConfigurations",
    "link_meshes",
    "link_poses",
    "load_robot",
    "robot_card",
    "robot_names",
    "stand",
    "uniform_configurations",
]
