"""Bundle adjustment against a scene that is known: exact without noise, better than its parts with it."""

import numpy as np
from scipy.optimize import approx_fprime

from carlaloc_env.core.array_types import Array
from carlaloc_env.core.transforms import quat_to_matrix, rotvec_to_quat
from recorder.slam.bundle_adjustment import Sightings, StereoCamera, adjust

CAMERA = StereoCamera(focal_px=400.0, centre_px=np.array([320.0, 180.0]), baseline_m=0.5)
STEP_M = 0.8


def scene(images: int, *, noise_px: float, seed: int) -> tuple[Array, Array, Sightings]:
    """True poses along a slight bend, points before them, and what is seen of these."""
    rng = np.random.default_rng(seed)
    T = np.tile(np.eye(4), (images, 1, 1))
    for k in range(images):
        T[k, :3, :3] = quat_to_matrix(rotvec_to_quat([0.0, -0.01 * k, 0.0]))
        T[k, :3, 3] = -T[k, :3, :3] @ [0.02 * k, 0.0, STEP_M * k]
    points = np.column_stack([rng.uniform(-12, 12, 250), rng.uniform(-3, 2, 250), rng.uniform(12, 40, 250)])
    image, landmark = (part.ravel() for part in np.mgrid[:images, : len(points)])
    local = np.einsum("mij,mj->mi", T[image, :3, :3], points[landmark]) + T[image, :3, 3]
    pixel = CAMERA.project(local) + rng.normal(0.0, noise_px, (len(image), 3))
    return T, points, Sightings(image=image, landmark=landmark, pixel=pixel)


def shifted(T: Array, points: Array, seed: int) -> tuple[Array, Array]:
    rng = np.random.default_rng(seed)
    start = T.copy()
    start[1:, :3, 3] += rng.normal(0.0, 0.1, (len(T) - 1, 3))
    return start, points + rng.normal(0.0, 0.5, points.shape)


def eye_m(T: Array) -> Array:
    return -np.einsum("kji,kj->ki", T[:, :3, :3], T[:, :3, 3])


def test_the_derivative_is_that_of_the_projection() -> None:
    point = np.array([1.0, -2.0, 9.0])
    for k in range(3):
        slope = approx_fprime(point, lambda p, k=k: CAMERA.project(p[None])[0, k], 1e-7)
        np.testing.assert_allclose(CAMERA.jacobian(point[None])[0, k], slope, atol=1e-4)


def test_without_noise_it_finds_the_truth() -> None:
    T, points, seen = scene(6, noise_px=0.0, seed=1)
    found, landmarks = adjust(CAMERA, *shifted(T, points, 2), seen, iterations=30)
    np.testing.assert_allclose(eye_m(found), eye_m(T), atol=1e-4)
    np.testing.assert_allclose(landmarks, points, atol=1e-2)


def test_a_right_image_may_be_missing_and_a_wrong_sighting_changes_little() -> None:
    T, points, seen = scene(6, noise_px=0.1, seed=3)
    seen.pixel[::3, 2] = np.nan
    seen.pixel[5::50, 0] += 40.0
    found, _ = adjust(CAMERA, *shifted(T, points, 4), seen, iterations=30)
    np.testing.assert_allclose(eye_m(found), eye_m(T), atol=0.02)


def test_images_in_between_make_the_last_place_better() -> None:
    """RMS over 30 draws; eight images against the first and the last of them."""
    pair, window = [], []
    for seed in range(30):
        T, points, seen = scene(8, noise_px=0.5, seed=seed)
        ends = np.flatnonzero((seen.image == 0) | (seen.image == 7))
        two = Sightings(
            image=np.minimum(seen.image[ends], 1), landmark=seen.landmark[ends], pixel=seen.pixel[ends]
        )
        for errors, start, sightings in ((pair, T[[0, 7]], two), (window, T, seen)):
            found, _ = adjust(CAMERA, start, points, sightings)
            errors.append(np.linalg.norm(eye_m(found)[-1] - eye_m(T)[-1]))
    assert np.sqrt(np.mean(np.square(window))) < 0.75 * np.sqrt(np.mean(np.square(pair)))
