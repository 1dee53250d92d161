"""Lists what other simulators call settings and effects that are here too, for users who come from them.

Sources of the names: v2e's v2e_args.py and EventEmulator (Hu, Liu and Delbruck, CVPR Workshops 2021); the flags of ESIM
(Rebecq, Gehrig and Scaramuzza, CoRL 2018); esim_py and esim_torch of rpg_vid2e (Gehrig et al., CVPR 2020); Mitsuba 3.
"""

from __future__ import annotations

from typing import NamedTuple


class Elsewhere(NamedTuple):
    """Names a setting of another simulator.

    Attributes:
        whose: the simulator's.
        ours: the setting or the effect that is the same here; "" for what is not to be chosen here.
        note: what differs.
    """

    whose: str
    ours: str
    note: str = ""


_IN_US = "in microseconds"
_OF_THRESHOLD = "as a fraction of the threshold"
_FROM_RATE = "an rms, which davis_rs.sensor.effects.ShotNoise.of_rate gives from a rate"

NAMES_ELSEWHERE: dict[str, Elsewhere] = {
    "pos_thres": Elsewhere("v2e", "contrast_threshold"),
    "neg_thres": Elsewhere("v2e", "contrast_threshold_off"),
    "sigma_thres": Elsewhere("v2e", "threshold_mismatch", _OF_THRESHOLD),
    "cutoff_hz": Elsewhere("v2e", "photoreceptor_bandwidth_hz"),
    "leak_rate_hz": Elsewhere("v2e", "leak_rate_hz"),
    "leak_jitter_fraction": Elsewhere("v2e", "leak_rate_hz", "its parameter jitter"),
    "noise_rate_cov_decades": Elsewhere("v2e", "leak_rate_hz", "its parameter spread, 2.3 times the decades"),
    "shot_noise_rate_hz": Elsewhere("v2e", "shot_noise_rms", _FROM_RATE),
    "photoreceptor_noise": Elsewhere("v2e", "shot_noise_rms", _FROM_RATE),
    "refractory_period_s": Elsewhere("v2e", "refractory_period_us", _IN_US),
    "refractory_period": Elsewhere("v2e and esim_py", "refractory_period_us", _IN_US),
    "label_signal_noise": Elsewhere("v2e", "signal_window_us", "how far off a match may be, in microseconds"),
    "dvs_emulator_seed": Elsewhere("v2e", "seed"),
    "dvs_params": Elsewhere("v2e", "sensor"),
    "dvs128": Elsewhere("v2e", "size", "128x128"),
    "dvs240": Elsewhere("v2e", "size", "240x180"),
    "dvs346": Elsewhere("v2e", "size", "346x260"),
    "dvs640": Elsewhere("v2e", "size", "640x480"),
    "dvs1024": Elsewhere("v2e", "size", "1024x768"),
    "output_width": Elsewhere("v2e", "size", "width and height together"),
    "output_height": Elsewhere("v2e", "size", "width and height together"),
    "input_frame_rate": Elsewhere("v2e", "fps"),
    "input_slowmotion_factor": Elsewhere("v2e", "slow_motion"),
    "start_time": Elsewhere("v2e", "start_s"),
    "stop_time": Elsewhere("v2e", "stop_s"),
    "hdr": Elsewhere("v2e", "transfer", "linear, and frames of linear values: no logarithms"),
    "disable_slomo": Elsewhere("v2e", "interpolation", "linear or cubic"),
    "slomo_model": Elsewhere("v2e", "interpolation"),
    "timestamp_resolution": Elsewhere("v2e", "max_displacement_px", "in pixels of motion, not in seconds"),
    "auto_timestamp_resolution": Elsewhere("v2e", "max_displacement_px"),
    "dvs_text": Elsewhere("v2e", "events_format", "text"),
    "dvs_numpy": Elsewhere("v2e", "events_format", "npy"),
    "dvs_h5": Elsewhere("v2e", "events_format", "dsec or e2vid"),
    "dvs_aedat4": Elsewhere("v2e", "events_format", "aedat4"),
    "dvs_aedat2": Elsewhere("v2e", "events_format", "aedat2"),
    "contrast_threshold_pos": Elsewhere("ESIM", "contrast_threshold"),
    "contrast_threshold_neg": Elsewhere("ESIM", "contrast_threshold_off"),
    "contrast_threshold_positive": Elsewhere("rpg_vid2e", "contrast_threshold"),
    "contrast_threshold_negative": Elsewhere("rpg_vid2e", "contrast_threshold_off"),
    "cp": Elsewhere("rpg_vid2e", "contrast_threshold"),
    "cn": Elsewhere("rpg_vid2e", "contrast_threshold_off"),
    "contrast_threshold_sigma_pos": Elsewhere("ESIM", "threshold_mismatch", _OF_THRESHOLD),
    "contrast_threshold_sigma_neg": Elsewhere("ESIM", "threshold_mismatch", _OF_THRESHOLD),
    "refractory_period_ns": Elsewhere("ESIM and rpg_vid2e", "refractory_period_us", _IN_US),
    "rp": Elsewhere("rpg_vid2e", "refractory_period_us", _IN_US),
    "exposure_time_ms": Elsewhere("ESIM", "aps", "its parameter exposure_us, in microseconds"),
    "use_log_image": Elsewhere("ESIM", "", "events are always those of log intensity"),
    "use_log": Elsewhere("esim_py", "", "events are always those of log intensity"),
    "random_seed": Elsewhere("ESIM", "seed"),
    "simulation_minimum_framerate": Elsewhere("ESIM", "render_rate_hz"),
    "simulation_adaptive_sampling_lambda": Elsewhere("ESIM", "max_displacement_px"),
    "simulation_adaptive_sampling_method": Elsewhere("ESIM", "max_displacement_px", "tolerance is the other one"),
    "simulation_post_gaussian_blur_sigma": Elsewhere("ESIM", "lens_blur_px"),
    "data_source_start_time_s": Elsewhere("ESIM", "start_s"),
    "data_source_stop_time_s": Elsewhere("ESIM", "stop_s"),
    "simulation_imu_rate": Elsewhere("ESIM", "imu_rate_hz"),
    "ros_publisher_frame_rate": Elsewhere("ESIM", "frame_rate_hz"),
    "ros_publisher_depth_rate": Elsewhere("ESIM", "depth_rate_hz"),
    "ros_publisher_optic_flow_rate": Elsewhere("ESIM", "flow_rate_hz"),
    "trajectory_csv_file": Elsewhere("ESIM", "trajectory"),
    "trajectory_length_s": Elsewhere("ESIM", "duration_s"),
    "spp": Elsewhere("Mitsuba", "rays_per_pixel"),
    "sample_count": Elsewhere("Mitsuba", "rays_per_pixel"),
}
"""By the name in small letters, with underscores."""
