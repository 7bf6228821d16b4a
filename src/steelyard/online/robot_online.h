#include <stdbool.h>
#include <stdint.h>

/*SIZES*/
#ifdef __cplusplus
extern "C" {
#endif

/* How a call ended. Parameters of an answer are possible in every case. */
typedef enum {
    ROBOT_ONLINE_SOLVED = 0,    /* the best parameters, or: the sample was counted */
    ROBOT_ONLINE_UNCHANGED = 1, /* the given base parameters are possible as they are */
    ROBOT_ONLINE_STOPPED = 2,   /* not the best: the last possible ones, after the most iterations */
    ROBOT_ONLINE_REFUSED = 3    /* an argument is no number or out of range; nothing was computed */
} robot_online_status;

typedef struct {
    double base[ROBOT_ONLINE_BASE_COUNT];             /* in the order of the robot's model */
    double parameters[ROBOT_ONLINE_PARAMETER_COUNT];  /* likewise */
    double objective;   /* squared distance of the correction, or the objective of the fit */
    double gap;         /* an estimate of how far the objective is from the least one */
    int32_t iterations;
    robot_online_status status;
} robot_online_answer;

/* What the samples say: for each joint a triangular factor, and how many samples count. */
typedef struct {
    double triangle[ROBOT_ONLINE_TRIANGLE_SIZE];
    double count[ROBOT_ONLINE_JOINT_COUNT];
} robot_online_data;

/* A number with twice the digits. */
typedef struct {
    double high;
    double low;
} robot_online_pair;

/* Memory of a call; nothing is kept in it from one call to the next. */
typedef struct {
    bool in_pairs;
    double constant;
    double margin;
    double gap;
    double length;
    double unknowns[ROBOT_ONLINE_VARIABLES];
    double before[ROBOT_ONLINE_VARIABLES];
    double direction[ROBOT_ONLINE_VARIABLES];
    double linear[ROBOT_ONLINE_VARIABLES];
    double residual[ROBOT_ONLINE_VARIABLES];
    double column_doubles[ROBOT_ONLINE_VARIABLES];
    double matrix_doubles[ROBOT_ONLINE_MOST_ENTRIES];
    double factor_doubles[ROBOT_ONLINE_MOST_ENTRIES];
    double curvature[ROBOT_ONLINE_MOST_ENTRIES];
    robot_online_pair matrix_pairs[ROBOT_ONLINE_ENTRIES];
    robot_online_pair factor_pairs[ROBOT_ONLINE_ENTRIES];
    robot_online_pair column_pairs[ROBOT_ONLINE_VARIABLES];
    double product_doubles[ROBOT_ONLINE_TRIANGLE * ROBOT_ONLINE_TRIANGLE];
    robot_online_pair product_pairs[ROBOT_ONLINE_TRIANGLE * ROBOT_ONLINE_TRIANGLE];
    double scalars[ROBOT_ONLINE_SCALAR_PLACES];
    double scalar_steps[ROBOT_ONLINE_SCALAR_PLACES];
    double scalar_multipliers[ROBOT_ONLINE_SCALAR_PLACES];
    double scalar_multiplier_steps[ROBOT_ONLINE_SCALAR_PLACES];
    double scalar_corrections[ROBOT_ONLINE_SCALAR_PLACES];
    double matrices[ROBOT_ONLINE_ELEMENT_PLACES];
    double steps[ROBOT_ONLINE_ELEMENT_PLACES];
    double multipliers[ROBOT_ONLINE_ELEMENT_PLACES];
    double multiplier_steps[ROBOT_ONLINE_ELEMENT_PLACES];
    double corrections[ROBOT_ONLINE_ELEMENT_PLACES];
    double inverses[ROBOT_ONLINE_ELEMENT_PLACES];
    double roots[ROBOT_ONLINE_ELEMENT_PLACES];
    double multiplier_roots[ROBOT_ONLINE_ELEMENT_PLACES];
    double found_base[ROBOT_ONLINE_BASE_COUNT];
    double row[ROBOT_ONLINE_BASE_COUNT + 1];
    double normal[ROBOT_ONLINE_BASE_COUNT * ROBOT_ONLINE_BASE_COUNT];
} robot_online_workspace;

/* The possible parameters nearest to given base parameters: least squared distance, with the
 * smallest parameters that do not show. */
robot_online_status robot_online_correct(const double *base, robot_online_workspace *work,
                                         robot_online_answer *answer);

/* Empty data. */
void robot_online_begin(robot_online_data *data);

/* Count one sample of all joints: the base regressor (joint by joint, row by row) and the torques.
 * What was counted before counts `forget` times as much, between 0 and 1; 1 forgets nothing. Data
 * stay as they are where the sample is refused. */
robot_online_status robot_online_update(robot_online_data *data, const double *regressor,
                                        const double *torque, double forget,
                                        robot_online_workspace *work);

/* The same with the rows of those joints alone that are marked. The others are not read and forget
 * nothing. Leave out a joint that is at rest, because its friction then is not that of motion, and
 * one whose torque is clipped. */
robot_online_status robot_online_update_joints(robot_online_data *data, const double *regressor,
                                               const double *torque, const bool *counted,
                                               double forget, robot_online_workspace *work);

/* The squared residuals of each joint at base parameters; divided by the counts, and after the
 * square root, they are the deviations whose inverses are weights of the joints. */
void robot_online_squared_residuals(const robot_online_data *data, const double *base,
                                    double *squares);

/* The possible parameters of the least sum of half the squared, weighted residuals and of
 * `prior_weight` times the distance from the prior, between 1e-12 and 1e12. */
robot_online_status robot_online_fit(const robot_online_data *data, const double *weights,
                                     double prior_weight, robot_online_workspace *work,
                                     robot_online_answer *answer);

#ifdef __cplusplus
}
#endif
