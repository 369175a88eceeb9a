"""Names and types of the fields of all logged ULog topics, in the order of PX4's log files.

They are those of PX4 v1.16.

PX4 writes the time stamp first, then the other fields by decreasing size.
"""

from __future__ import annotations

_INNOVATIONS = (
    "uint64_t timestamp;uint64_t timestamp_sample;float[2] gps_hvel;float gps_vvel;"
    "float[2] gps_hpos;float gps_vpos;float[2] ev_hvel;float ev_vvel;float[2] ev_hpos;float ev_vpos;"
    "float rng_vpos;float baro_vpos;float[2] aux_hvel;float[2] flow;float heading;"
    "float[3] mag_field;float[3] gravity;float[2] drag;float airspeed;float beta;float hagl;"
    "float hagl_rate;"
)
_VECTOR = "uint64_t timestamp;uint64_t timestamp_sample;float[3] xyz;"

FORMATS: dict[str, str] = {
    "sensor_combined": (
        "uint64_t timestamp;float[3] gyro_rad;uint32_t gyro_integral_dt;"
        "int32_t accelerometer_timestamp_relative;float[3] accelerometer_m_s2;"
        "uint32_t accelerometer_integral_dt;uint8_t accelerometer_clipping;uint8_t gyro_clipping;"
        "uint8_t accel_calibration_count;uint8_t gyro_calibration_count;"
    ),
    "vehicle_angular_velocity": (
        "uint64_t timestamp;uint64_t timestamp_sample;float[3] xyz;float[3] xyz_derivative;"
    ),
    "vehicle_rates_setpoint": (
        "uint64_t timestamp;float roll;float pitch;float yaw;float[3] thrust_body;bool reset_integral;"
    ),
    "vehicle_thrust_setpoint": _VECTOR,
    "vehicle_torque_setpoint": _VECTOR,
    "vehicle_attitude": (
        "uint64_t timestamp;uint64_t timestamp_sample;float[4] q;float[4] delta_q_reset;"
        "uint8_t quat_reset_counter;"
    ),
    "vehicle_attitude_setpoint": (
        "uint64_t timestamp;float yaw_sp_move_rate;float[4] q_d;float[3] thrust_body;"
        "bool reset_integral;bool fw_control_yaw_wheel;"
    ),
    "vehicle_acceleration": _VECTOR,
    "vehicle_local_position": (
        "uint64_t timestamp;uint64_t timestamp_sample;uint64_t ref_timestamp;double ref_lat;"
        "double ref_lon;float x;float y;float z;float[2] delta_xy;float delta_z;float vx;float vy;"
        "float vz;float z_deriv;float[2] delta_vxy;float delta_vz;float ax;float ay;float az;"
        "float heading;float heading_var;float unaided_heading;float delta_heading;float tilt_var;"
        "float ref_alt;float dist_bottom;float dist_bottom_var;float delta_dist_bottom;float eph;"
        "float epv;float evh;float evv;float vxy_max;float vz_max;float hagl_min;float hagl_max_z;"
        "float hagl_max_xy;bool xy_valid;bool z_valid;bool v_xy_valid;bool v_z_valid;"
        "uint8_t xy_reset_counter;uint8_t z_reset_counter;uint8_t vxy_reset_counter;"
        "uint8_t vz_reset_counter;uint8_t heading_reset_counter;bool heading_good_for_control;"
        "bool xy_global;bool z_global;bool dist_bottom_valid;uint8_t dist_bottom_reset_counter;"
        "uint8_t dist_bottom_sensor_bitfield;bool dead_reckoning;"
    ),
    "vehicle_local_position_setpoint": (
        "uint64_t timestamp;float x;float y;float z;float vx;float vy;float vz;float[3] acceleration;"
        "float[3] thrust;float yaw;float yawspeed;"
    ),
    "trajectory_setpoint": (
        "uint64_t timestamp;float[3] position;float[3] velocity;float[3] acceleration;float[3] jerk;"
        "float yaw;float yawspeed;"
    ),
    "actuator_motors": (
        "uint64_t timestamp;uint64_t timestamp_sample;float[12] control;uint16_t reversible_flags;"
    ),
    "offboard_control_mode": (
        "uint64_t timestamp;bool position;bool velocity;bool acceleration;bool attitude;bool body_rate;"
        "bool thrust_and_torque;bool direct_actuator;"
    ),
    "vehicle_global_position": (
        "uint64_t timestamp;uint64_t timestamp_sample;double lat;double lon;float alt;"
        "float alt_ellipsoid;float delta_alt;float delta_terrain;float eph;float epv;float terrain_alt;"
        "bool lat_lon_valid;bool alt_valid;uint8_t lat_lon_reset_counter;uint8_t alt_reset_counter;"
        "uint8_t terrain_reset_counter;bool terrain_alt_valid;bool dead_reckoning;"
    ),
    "vehicle_air_data": (
        "uint64_t timestamp;uint64_t timestamp_sample;uint32_t baro_device_id;float baro_alt_meter;"
        "float baro_pressure_pa;float ambient_temperature;float rho;uint8_t temperature_source;"
        "uint8_t calibration_count;"
    ),
    "vehicle_magnetometer": (
        "uint64_t timestamp;uint64_t timestamp_sample;uint32_t device_id;float[3] magnetometer_ga;"
        "uint8_t calibration_count;"
    ),
    "battery_status": (
        "uint64_t timestamp;float voltage_v;float current_a;float current_average_a;"
        "float discharged_mah;float remaining;float scale;float time_remaining_s;float temperature;"
        "float[14] voltage_cell_v;float max_cell_voltage_delta;float full_charge_capacity_wh;"
        "float remaining_capacity_wh;float nominal_voltage;float internal_resistance_estimate;"
        "float ocv_estimate;float ocv_estimate_filtered;float volt_based_soc_estimate;"
        "float voltage_prediction;float prediction_error;float estimation_covariance_norm;"
        "uint16_t capacity;uint16_t cycle_count;uint16_t average_time_to_empty;uint16_t serial_number;"
        "uint16_t manufacture_date;uint16_t state_of_health;uint16_t max_error;uint16_t interface_error;"
        "uint16_t faults;uint16_t over_discharge_count;bool connected;uint8_t cell_count;uint8_t source;"
        "uint8_t priority;uint8_t id;bool is_powering_off;bool is_required;uint8_t warning;"
    ),
    "rate_ctrl_status": (
        "uint64_t timestamp;float rollspeed_integ;float pitchspeed_integ;float yawspeed_integ;"
        "float wheel_rate_integ;"
    ),
    "control_allocator_status": (
        "uint64_t timestamp;float[3] unallocated_torque;float[3] unallocated_thrust;"
        "uint16_t handled_motor_failure_mask;bool torque_setpoint_achieved;"
        "bool thrust_setpoint_achieved;int8_t[16] actuator_saturation;"
    ),
    "estimator_status": (
        "uint64_t timestamp;uint64_t timestamp_sample;uint64_t control_mode_flags;"
        "float[3] output_tracking_error;uint32_t filter_fault_flags;float pos_horiz_accuracy;"
        "float pos_vert_accuracy;float hdg_test_ratio;float vel_test_ratio;float pos_test_ratio;"
        "float hgt_test_ratio;float tas_test_ratio;float hagl_test_ratio;float beta_test_ratio;"
        "float time_slip;uint32_t accel_device_id;uint32_t gyro_device_id;uint32_t baro_device_id;"
        "uint32_t mag_device_id;float mag_inclination_deg;float mag_inclination_ref_deg;"
        "float mag_strength_gs;float mag_strength_ref_gs;uint16_t gps_check_fail_flags;"
        "uint16_t solution_status_flags;uint8_t reset_count_vel_ne;uint8_t reset_count_vel_d;"
        "uint8_t reset_count_pos_ne;uint8_t reset_count_pod_d;uint8_t reset_count_quat;"
        "bool pre_flt_fail_innov_heading;bool pre_flt_fail_innov_height;"
        "bool pre_flt_fail_innov_pos_horiz;bool pre_flt_fail_innov_vel_horiz;"
        "bool pre_flt_fail_innov_vel_vert;bool pre_flt_fail_mag_field_disturbed;uint8_t health_flags;"
        "uint8_t timeout_flags;"
    ),
    "estimator_states": (
        "uint64_t timestamp;uint64_t timestamp_sample;float[25] states;float[24] covariances;"
        "uint8_t n_states;"
    ),
    "estimator_sensor_bias": (
        "uint64_t timestamp;uint64_t timestamp_sample;uint32_t gyro_device_id;float[3] gyro_bias;"
        "float gyro_bias_limit;float[3] gyro_bias_variance;uint32_t accel_device_id;float[3] accel_bias;"
        "float accel_bias_limit;float[3] accel_bias_variance;uint32_t mag_device_id;float[3] mag_bias;"
        "float mag_bias_limit;float[3] mag_bias_variance;bool gyro_bias_valid;bool gyro_bias_stable;"
        "bool accel_bias_valid;bool accel_bias_stable;bool mag_bias_valid;bool mag_bias_stable;"
    ),
    "estimator_status_flags": (
        "uint64_t timestamp;uint64_t timestamp_sample;uint32_t control_status_changes;"
        "uint32_t fault_status_changes;uint32_t innovation_fault_status_changes;bool cs_tilt_align;"
        "bool cs_yaw_align;bool cs_gnss_pos;bool cs_opt_flow;bool cs_mag_hdg;bool cs_mag_3d;"
        "bool cs_mag_dec;bool cs_in_air;bool cs_wind;bool cs_baro_hgt;bool cs_rng_hgt;bool cs_gps_hgt;"
        "bool cs_ev_pos;bool cs_ev_yaw;bool cs_ev_hgt;bool cs_fuse_beta;bool cs_mag_field_disturbed;"
        "bool cs_fixed_wing;bool cs_mag_fault;bool cs_fuse_aspd;bool cs_gnd_effect;bool cs_rng_stuck;"
        "bool cs_gnss_yaw;bool cs_mag_aligned_in_flight;bool cs_ev_vel;bool cs_synthetic_mag_z;"
        "bool cs_vehicle_at_rest;bool cs_gnss_yaw_fault;bool cs_rng_fault;"
        "bool cs_inertial_dead_reckoning;bool cs_wind_dead_reckoning;bool cs_rng_kin_consistent;"
        "bool cs_fake_pos;bool cs_fake_hgt;bool cs_gravity_vector;bool cs_mag;bool cs_ev_yaw_fault;"
        "bool cs_mag_heading_consistent;bool cs_aux_gpos;bool cs_rng_terrain;bool cs_opt_flow_terrain;"
        "bool cs_valid_fake_pos;bool cs_constant_pos;bool cs_baro_fault;bool cs_gnss_vel;"
        "bool fs_bad_mag_x;bool fs_bad_mag_y;bool fs_bad_mag_z;bool fs_bad_hdg;bool fs_bad_mag_decl;"
        "bool fs_bad_airspeed;bool fs_bad_sideslip;bool fs_bad_optflow_x;bool fs_bad_optflow_y;"
        "bool fs_bad_acc_vertical;bool fs_bad_acc_clipping;bool reject_hor_vel;bool reject_ver_vel;"
        "bool reject_hor_pos;bool reject_ver_pos;bool reject_yaw;bool reject_airspeed;"
        "bool reject_sideslip;bool reject_hagl;bool reject_optflow_x;bool reject_optflow_y;"
    ),
    "estimator_innovations": _INNOVATIONS,
    "estimator_innovation_variances": _INNOVATIONS,
    "estimator_innovation_test_ratios": _INNOVATIONS,
    "vehicle_status": (
        "uint64_t timestamp;uint64_t armed_time;uint64_t takeoff_time;uint64_t nav_state_timestamp;"
        "uint32_t valid_nav_states_mask;uint32_t can_set_nav_states_mask;"
        "uint16_t failure_detector_status;uint8_t arming_state;uint8_t latest_arming_reason;"
        "uint8_t latest_disarming_reason;uint8_t nav_state_user_intention;uint8_t nav_state;"
        "uint8_t executor_in_charge;uint8_t hil_state;uint8_t vehicle_type;bool failsafe;"
        "bool failsafe_and_user_took_over;uint8_t failsafe_defer_state;bool gcs_connection_lost;"
        "uint8_t gcs_connection_lost_counter;bool high_latency_data_link_lost;bool is_vtol;"
        "bool is_vtol_tailsitter;bool in_transition_mode;bool in_transition_to_fw;uint8_t system_type;"
        "uint8_t system_id;uint8_t component_id;bool safety_button_available;bool safety_off;"
        "bool power_input_valid;bool usb_connected;bool open_drone_id_system_present;"
        "bool open_drone_id_system_healthy;bool parachute_system_present;bool parachute_system_healthy;"
        "bool rc_calibration_in_progress;bool calibration_enabled;bool pre_flight_checks_pass;"
    ),
    "vehicle_control_mode": (
        "uint64_t timestamp;bool flag_armed;bool flag_multicopter_position_control_enabled;"
        "bool flag_control_manual_enabled;bool flag_control_auto_enabled;"
        "bool flag_control_offboard_enabled;bool flag_control_position_enabled;"
        "bool flag_control_velocity_enabled;bool flag_control_altitude_enabled;"
        "bool flag_control_climb_rate_enabled;bool flag_control_acceleration_enabled;"
        "bool flag_control_attitude_enabled;bool flag_control_rates_enabled;"
        "bool flag_control_allocation_enabled;bool flag_control_termination_enabled;uint8_t source_id;"
    ),
    "vehicle_land_detected": (
        "uint64_t timestamp;bool freefall;bool ground_contact;bool maybe_landed;bool landed;"
        "bool in_ground_effect;bool in_descend;bool has_low_throttle;bool vertical_movement;"
        "bool horizontal_movement;bool rotational_movement;bool close_to_ground_or_skipped_check;"
        "bool at_rest;"
    ),
    "actuator_armed": (
        "uint64_t timestamp;bool armed;bool prearmed;bool ready_to_arm;bool lockdown;"
        "bool manual_lockdown;bool force_failsafe;bool in_esc_calibration_mode;"
    ),
    "failsafe_flags": (
        "uint64_t timestamp;uint32_t mode_req_angular_velocity;uint32_t mode_req_attitude;"
        "uint32_t mode_req_local_alt;uint32_t mode_req_local_position;"
        "uint32_t mode_req_local_position_relaxed;uint32_t mode_req_global_position;"
        "uint32_t mode_req_mission;uint32_t mode_req_offboard_signal;uint32_t mode_req_home_position;"
        "uint32_t mode_req_wind_and_flight_time_compliance;uint32_t mode_req_prevent_arming;"
        "uint32_t mode_req_manual_control;uint32_t mode_req_other;bool angular_velocity_invalid;"
        "bool attitude_invalid;bool local_altitude_invalid;bool local_position_invalid;"
        "bool local_position_invalid_relaxed;bool local_velocity_invalid;bool global_position_invalid;"
        "bool auto_mission_missing;bool offboard_control_signal_lost;bool home_position_invalid;"
        "bool manual_control_signal_lost;bool gcs_connection_lost;uint8_t battery_warning;"
        "bool battery_low_remaining_time;bool battery_unhealthy;bool geofence_breached;"
        "bool mission_failure;bool vtol_fixed_wing_system_failure;bool wind_limit_exceeded;"
        "bool flight_time_limit_exceeded;bool local_position_accuracy_low;bool navigator_failure;"
        "bool fd_critical_failure;bool fd_esc_arming_failure;bool fd_imbalanced_prop;"
        "bool fd_motor_failure;"
    ),
    "takeoff_status": ("uint64_t timestamp;float tilt_limit;uint8_t takeoff_state;"),
    "home_position": (
        "uint64_t timestamp;double lat;double lon;float alt;float x;float y;float z;float yaw;"
        "uint32_t update_count;bool valid_alt;bool valid_hpos;bool valid_lpos;bool manual_home;"
    ),
    "vehicle_visual_odometry": (
        "uint64_t timestamp;uint64_t timestamp_sample;float[3] position;float[4] q;float[3] velocity;"
        "float[3] angular_velocity;float[3] position_variance;float[3] orientation_variance;"
        "float[3] velocity_variance;uint8_t pose_frame;uint8_t velocity_frame;uint8_t reset_counter;"
        "int8_t quality;"
    ),
}
"""Topic -> its fields as `type name;`, without padding."""
