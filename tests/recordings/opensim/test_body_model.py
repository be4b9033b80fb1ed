"""Models of OpenSim 1, 3 and 4: their forward kinematics against closed forms and scipy's rotations."""

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from stridelab.conventions import Points
from stridelab.errors import UnreadableFile
from stridelab.recordings.opensim.body_model import BodyModel, read_body_model
from stridelab.recordings.opensim.kinematics import body_poses, complete_coordinates
from support.recordings.body_model_files import IDENTITY, Link, human_links, model_text, transform_axes

T = np.linspace(0.0, 2.0, 9)
A, B = 0.4 * np.sin(T), 0.9 * np.cos(2.0 * T)
DIALECTS = pytest.mark.parametrize("version", [3, 4])


def com_m(model: BodyModel, **given: np.ndarray) -> Points:
    n = len(T)
    poses = body_poses(model, complete_coordinates(model, given, n), n)
    moments = [body.mass_kg * poses[name].point_at(body.com_m) for name, body in model.bodies.items()]
    return np.asarray(np.sum(moments, axis=0) / model.mass_kg)


def one_body(kind: str, coordinates: tuple[str, ...], **more: object) -> list[Link]:
    return [Link("body", kind, "ground", (0.1, 0.2, 0.3), 2.0, (0.5, -0.4, 0.3), coordinates, **more)]


@DIALECTS
def test_the_centre_of_mass_of_a_double_pendulum(version: int) -> None:
    links = [
        Link("upper", "PinJoint", "ground", (0, 1, 0), 3.0, (0, -0.3, 0), ("a",)),
        Link("lower", "PinJoint", "upper", (0, -0.6, 0), 1.0, (0, -0.2, 0), ("b",)),
    ]
    model = read_body_model(model_text(links, version=version), "pendulum.osim")

    def down(angle: np.ndarray) -> np.ndarray:
        return np.column_stack([np.sin(angle), -np.cos(angle), 0 * angle])

    truth = np.array([0, 1, 0]) + (3.0 * 0.3 * down(A) + 1.0 * (0.6 * down(A) + 0.2 * down(A + B))) / 4.0
    np.testing.assert_allclose(com_m(model, a=A, b=B), truth, atol=1e-14)
    assert model.mass_kg == 4.0
    assert all(model.coordinates[name].rotational for name in "ab")


@DIALECTS
@pytest.mark.parametrize(
    ("kind", "turns", "moves"),
    [
        ("WeldJoint", "", ""),
        ("PinJoint", "Z", ""),
        ("SliderJoint", "", "x"),
        ("UniversalJoint", "XY", ""),
        ("BallJoint", "XYZ", ""),
        ("PlanarJoint", "Z", "xy"),
        ("FreeJoint", "XYZ", "xyz"),
    ],
)
def test_each_joint_in_frames_that_are_turned_and_moved(version: int, kind: str, turns: str, moves: str) -> None:
    rng = np.random.default_rng(3)
    names = tuple(f"q{k}" for k in range(len(turns) + len(moves)))
    q = {name: rng.uniform(-1.0, 1.0, len(T)) for name in names}
    links = one_body(kind, names, turn_rad=(0.3, -0.5, 0.8), origin_m=(0.02, 0.05, -0.04))
    model = read_body_model(model_text(links, version=version), "one.osim")
    fixed = Rotation.from_euler("XYZ", (0.3, -0.5, 0.8))
    values = np.column_stack([q[name] for name in names]) if names else np.zeros((len(T), 0))
    turned = Rotation.from_euler(turns, values[:, : len(turns)]) if turns else Rotation.identity(len(T))
    shift = np.zeros((len(T), 3))
    for k, axis in enumerate(moves):
        shift[:, "xyz".index(axis)] = values[:, len(turns) + k]
    R = fixed * turned * fixed.inv()
    local = np.array([0.5, -0.4, 0.3]) - np.array([0.02, 0.05, -0.04])
    truth = np.array([0.1, 0.2, 0.3]) + fixed.apply(shift) + R.apply(local)
    np.testing.assert_allclose(com_m(model, **q), truth, atol=1e-14)
    assert [model.coordinates[name].rotational for name in names] == [k < len(turns) for k in range(len(names))]


@DIALECTS
def test_a_custom_joint_turns_and_moves_along_its_own_axes(version: int) -> None:
    double = "<LinearFunction><coefficients>2 0.1</coefficients></LinearFunction>"
    constant = "<Constant><value>0.25</value></Constant>"
    axes = transform_axes(
        ("knee", "0 0 2", IDENTITY),
        ("", "1 0 0", constant),
        ("knee", "0 1 1", double),
        ("knee", "0 3 0", double),
        ("slide", "1 0 0", IDENTITY),
        ("", "0 0 1", "<Constant><value>0</value></Constant>"),
        wrapped=version == 3,
    )
    model = read_body_model(model_text(one_body("CustomJoint", ("knee", "slide"), axes=axes), version=version), "k")

    def about(axis: list[float], angle: np.ndarray) -> Rotation:
        return Rotation.from_rotvec(np.outer(angle, axis))

    R = about([0, 0, 1], A) * about([1, 0, 0], 0.25 + 0 * A) * about([0, 0.5**0.5, 0.5**0.5], 2 * A + 0.1)
    shift = np.column_stack([B, 2 * A + 0.1, 0 * A])
    truth = np.array([0.1, 0.2, 0.3]) + shift + R.apply([0.5, -0.4, 0.3])
    np.testing.assert_allclose(com_m(model, knee=A, slide=B), truth, atol=1e-14)
    assert (model.coordinates["knee"].rotational, model.coordinates["slide"].rotational) == (True, False)


def test_a_coupled_coordinate_follows_unless_it_is_given() -> None:
    constraint = (
        '<CoordinateCouplerConstraint name="c"><coupled_coordinates_function><LinearFunction><coefficients>2 0.5'
        "</coefficients></LinearFunction></coupled_coordinates_function><independent_coordinate_names>a"
        "</independent_coordinate_names><dependent_coordinate_name>b</dependent_coordinate_name>"
        "</CoordinateCouplerConstraint>"
    )
    links = [*one_body("PinJoint", ("a",)), Link("second", "PinJoint", "body", (0, 0, 0), 1.0, (1, 0, 0), ("b",))]
    model = read_body_model(model_text(links, constraints=constraint), "coupled.osim")
    np.testing.assert_array_equal(complete_coordinates(model, {"a": A}, len(T))["b"], 2 * A + 0.5)
    np.testing.assert_array_equal(complete_coordinates(model, {"a": A, "b": B}, len(T))["b"], B)
    off = constraint.replace('name="c">', 'name="c"><isEnforced>false</isEnforced>')
    model = read_body_model(model_text(links, constraints=off), "free.osim")
    np.testing.assert_array_equal(complete_coordinates(model, {"a": A}, len(T))["b"], 0 * A)


def test_the_joints_of_opensim_1_list_only_their_motions() -> None:
    listed = "".join(
        f"<TransformAxis><function/><coordinate>{name}</coordinate><is_rotation>{turns}</is_rotation>"
        f"<axis>{axis}</axis></TransformAxis>"
        for name, turns, axis in (("slide", "false", "0 1 0"), ("a", "true", "0 0 1"), ("b", "true", "1 0 0"))
    )
    axes = f"<TransformAxisSet><objects>{listed}</objects></TransformAxisSet>"
    links = one_body("CustomJoint", ("slide", "a", "b"), axes=axes)
    model = read_body_model(model_text(links, version=3), "old.osim")
    R = Rotation.from_euler("ZX", np.column_stack([A, B]))
    truth = np.array([0.1, 0.2, 0.3]) + np.column_stack([0 * T, T, 0 * T]) + R.apply([0.5, -0.4, 0.3])
    np.testing.assert_allclose(com_m(model, slide=T, a=A, b=B), truth, atol=1e-14)


def test_a_licence_before_the_declaration_and_a_bare_ampersand_are_read() -> None:
    text = "<!-- a licence\n in two lines -->\n" + model_text(human_links(), extra="<credits>A & B</credits>")
    assert read_body_model(text, "licensed.osim").mass_kg == pytest.approx(70.0)


def test_the_gravity_of_the_model_gives_the_vertical() -> None:
    text = model_text(human_links()).replace("0 -9.80665 0", "0 0 -9.81")
    assert read_body_model(text, "z.osim").up.tolist() == [0, 0, 1]


GOOD = model_text(human_links())
TY = f"<coordinates>pelvis_ty</coordinates><axis>0 1 0</axis>{IDENTITY}"
SPLINE = "<SimmSpline><x>0 1</x><y>0 1</y></SimmSpline>"
BOMB = '<!DOCTYPE a [<!ENTITY b "bbbbbbbb"><!ENTITY c "&b;&b;&b;&b;">]>'


@pytest.mark.parametrize(
    ("text", "why"),
    [
        (GOOD.replace("\n<OpenSim", f"\n{BOMB}<OpenSim", 1), "document type"),
        (GOOD.replace("<Model", "<Model" + "><a" * 80, 1), "inside each other|well-formed"),
        (GOOD[: len(GOOD) // 2], "not well-formed"),
        (GOOD.replace("PinJoint", "EllipsoidJoint"), "EllipsoidJoint"),
        (GOOD.replace('name="tibia_l"', 'name="tibia_r"'), "two bodies"),
        (GOOD.replace("/bodyset/femur_l", "/bodyset/femur_x"), "femur_x"),
        (GOOD.replace("<socket_parent>/ground", "<socket_parent>/bodyset/torso"), "no chain of joints"),
        (GOOD.replace("<axis>0 0 1</axis>", "<axis>0 0 0</axis>"), "length zero"),
        (GOOD.replace("<mass>8.5</mass>", "<mass>-8.5</mass>"), "negative mass"),
        (GOOD.replace("<mass>8.5</mass>", "<mass>much</mass>"), "'much'"),
        (GOOD.replace("<LinearFunction>", "<Sine>").replace("</LinearFunction>", "</Sine>"), "Sine"),
        (GOOD.replace('<Coordinate name="pelvis_ty">', '<Coordinate name="height">'), "'pelvis_ty', which does not"),
        (GOOD.replace(TY, f"<coordinates/><axis>0 1 0</axis>{SPLINE}"), "function of no coordinate"),
        (GOOD.replace("<BodySet>", "<Bodies>").replace("</BodySet>", "</Bodies>"), "0 bodies"),
    ],
)
def test_a_model_that_cannot_be_used_is_refused_with_the_reason(text: str, why: str) -> None:
    assert text != GOOD
    with pytest.raises(UnreadableFile, match=why) as refused:
        read_body_model(text, "subject.osim")
    assert refused.value.code == "osim-broken"
    assert "subject.osim" in refused.value.message


def test_two_joints_of_one_body_are_refused() -> None:
    links = [*one_body("PinJoint", ("a",)), Link("other", "PinJoint", "ground", (0, 0, 0), 1.0, (0, 0, 0), ("b",))]
    text = model_text(links).replace("/bodyset/other", "/bodyset/body")
    with pytest.raises(UnreadableFile, match="two joints place"):
        read_body_model(text, "two.osim")


def test_the_free_joint_of_a_pelvis_in_both_dialects_is_the_same() -> None:
    rng = np.random.default_rng(1)
    old = read_body_model(model_text(human_links(wrapped=True), version=3), "3.osim")
    new = read_body_model(model_text(human_links()), "4.osim")
    q = {name: rng.uniform(-0.5, 0.5, len(T)) for name in new.coordinates}
    np.testing.assert_allclose(com_m(old, **q), com_m(new, **q), atol=1e-14)
