// Arms, flies to a position in OFFBOARD and lands with MAVSDK's library of the Python package mavsdk 4. Argument: URL.
#include <chrono>
#include <cmath>
#include <cstdio>
#include <cstdlib>
#include <thread>

extern "C" {  // the part of libcmavsdk.so that this program uses
struct PositionNedYaw { float north_m, east_m, down_m, yaw_deg; };
struct PositionVelocityNed { float north_m, east_m, down_m, vn, ve, vd; };
void *mavsdk_configuration_create_with_component_type(int);
void *mavsdk_create(void *);
int mavsdk_add_any_connection(void *, const char *);
void *mavsdk_first_autopilot(void *, double);
void *mavsdk_action_create(void *);
int mavsdk_action_arm(void *);
int mavsdk_action_land(void *);
void *mavsdk_offboard_create(void *);
int mavsdk_offboard_set_position_ned(void *, PositionNedYaw);
int mavsdk_offboard_start(void *);
void *mavsdk_telemetry_create(void *);
void mavsdk_telemetry_armed(void *, bool *);
void mavsdk_telemetry_position_velocity_ned(void *, PositionVelocityNed *);
}

template <typename Done> bool until(Done done, double seconds) {
    for (int i = 0; i < seconds * 20; i++) {
        if (done()) return true;
        std::this_thread::sleep_for(std::chrono::milliseconds(50));
    }
    return false;
}

int fail(const char *why) { std::fprintf(stderr, "%s\n", why); return 1; }

int main(int, char **argv) {
    const int companion_computer = 2, success = 1;
    void *sdk = mavsdk_create(mavsdk_configuration_create_with_component_type(companion_computer));
    if (mavsdk_add_any_connection(sdk, argv[1])) return fail("cannot open the connection");
    void *system = mavsdk_first_autopilot(sdk, 20.0);
    if (!system) return fail("no autopilot");
    void *action = mavsdk_action_create(system), *offboard = mavsdk_offboard_create(system);
    void *telemetry = mavsdk_telemetry_create(system);
    PositionVelocityNed at{};
    auto position = [&] { mavsdk_telemetry_position_velocity_ned(telemetry, &at); return std::isfinite(at.north_m); };
    if (!until(position, 20)) return fail("no position");
    PositionNedYaw target{at.north_m, at.east_m, at.down_m - 1.0f, 0};
    if (!until([&] {
            mavsdk_offboard_set_position_ned(offboard, target);
            return mavsdk_offboard_start(offboard) == success && mavsdk_action_arm(action) == success;
        }, 20)) return fail("OFFBOARD or arming was refused");
    auto near = [&] { position(); return std::fabs(at.down_m - target.down_m) < 0.2; };
    if (!until(near, 30)) return fail("not at the position");
    std::printf("at N %.2f E %.2f D %.2f\n", at.north_m, at.east_m, at.down_m);
    if (mavsdk_action_land(action) != success) return fail("landing was refused");
    bool armed = true;
    if (!until([&] { mavsdk_telemetry_armed(telemetry, &armed); return !armed; }, 60)) return fail("landing not confirmed");
    std::printf("landed\n");
    std::fflush(stdout);
    std::_Exit(0);
}
