/* capstan_adaptive.c: `adaptive` for the rig "Capstan-driven joint"; see capstan_adaptive.h. Written by `distal export-c`. */
#include "capstan_adaptive.h"

#include <math.h>
#include <string.h>

/* the rig's parameters and the noise, as the filter takes them */
static const float numbers[18] = {
  2e-05f, 0.001f, 0.15f, 0.0015f, 0.00038f, 0.005f,
  0.002f, 0.02f, 0.05f, 0.008f, 23000.0f, 2.0f,
  20.0f, 0.008f, 23000.0f, 2.0f, 20.0f, 40.0f
};

static inline float larger(float a, float b) { return a > b || b != b ? a : b; }
static inline float smaller(float a, float b) { return a < b || b != b ? a : b; }

static void prior(const float* restrict a0, const float* restrict a1, const float* restrict a2, float* restrict r0, float* restrict r1, float* restrict r2) {
  (void)a2;
  r0[0] = 0.0f;
  r0[1] = 0.0f;
  r0[2] = 0.150221892f;
  r0[3] = 0.0200092576f;
  r0[4] = 0.0503527565f;
  r0[5] = 20.0f;
  r0[6] = 20.0f;
  r0[7] = 1.0f;
  r1[0] = 0.00121846968f;
  r1[1] = 0.09f;
  r1[2] = 0.00246666697f;
  r1[3] = 3.58147614e-05f;
  r1[4] = 0.000382237737f;
  r1[5] = 16.0f;
  r1[6] = 16.0f;
  r1[7] = 0.0225f;
  const float v31 = fabsf(a0[0]);
  const float v33 = (float)(v31 <= 76.8069813f);
  const float v34 = a1[0] * v33;
  const float v35 = (float)(0.0f < v34);
  const float v36 = (v35 != 0.0f ? a0[0] : 0.0f);
  r2[0] = v36;
  r2[1] = 0.0f;
  r2[2] = 0.0f;
  r2[3] = 0.0f;
  const float v41 = (float)(0.0f < v34);
  const float v42 = (float)(v41 == 0.0f);
  const float v43 = (v42 != 0.0f ? 1.0f : 0.0f);
  r2[4] = v43;
  r2[5] = 0.0f;
  r2[6] = 0.0f;
}

static void readings(const float* restrict a0, const float* restrict a1, const float* restrict a2, const float* restrict a3, float* restrict r0) {
  r0[0] = a2[1];
  const float v3 = fabsf(a2[1]);
  const float v5 = (float)(v3 <= 76.8069813f);
  const float v6 = a2[3] * v5;
  r0[1] = v6;
  r0[2] = 1.24385446e-07f;
  r0[3] = 0.5f;
  r0[4] = 1.0f;
  const float v18 = a3[10] * a0[7];
  const float v23 = a1[2] * a2[0];
  const float v24 = a1[0] + v23;
  const float v25 = a3[5] * v24;
  const float v28 = a3[9] * a0[0];
  const float v29 = v25 - v28;
  const float v30 = v18 * v29;
  const float v32 = v30 + a0[5];
  const float v33 = (float)(0.0f < v32);
  const float v34 = (float)(v33 != 0.0f && v33 != 0.0f);
  const float v35 = a3[5] * v32;
  const float v36 = (v34 != 0.0f ? v35 : 0.0f);
  const float v38 = a3[14] * a0[7];
  const float v40 = a3[13] * a0[0];
  const float v41 = v40 - v25;
  const float v42 = v38 * v41;
  const float v44 = v42 + a0[6];
  const float v45 = (float)(0.0f < v44);
  const float v46 = (float)(v45 != 0.0f && v45 != 0.0f);
  const float v47 = a3[5] * v44;
  const float v48 = -v47;
  const float v49 = (v46 != 0.0f ? v48 : 0.0f);
  const float v50 = v36 + v49;
  const float v51 = a2[2] - v50;
  r0[5] = v51;
  r0[6] = a2[4];
  const float v55 = v18 * a3[5];
  const float v56 = a3[5] * v55;
  const float v57 = (v34 != 0.0f ? v56 : 0.0f);
  const float v58 = v38 * a3[5];
  const float v59 = a3[5] * v58;
  const float v60 = (v46 != 0.0f ? v59 : 0.0f);
  const float v61 = v57 + v60;
  r0[7] = v61;
  const float v66 = a0[4] * a3[5];
  const float v67 = (v34 != 0.0f ? v32 : 0.0f);
  const float v68 = (v46 != 0.0f ? v44 : 0.0f);
  const float v69 = v67 + v68;
  const float v70 = v66 * v69;
  const float v71 = a0[3] + v70;
  const float v72 = v71 * v71;
  const float v73 = 2.5e-05f + v72;
  const float v75 = 0.1f * v50;
  const float v76 = v75 * v75;
  const float v77 = v73 + v76;
  r0[8] = v77;
}

static void drive(const float* restrict a0, const float* restrict a1, const float* restrict a2, float* restrict r0) {
  const float v2 = (float)(a1[1] < 0.0f);
  const float v5 = a1[0] - a0[0];
  const float v6 = -a1[1];
  const float v7 = (v2 != 0.0f ? v6 : 0.0f);
  const float v8 = (float)(v2 == 0.0f);
  const float v10 = (v8 != 0.0f ? 1.0f : 0.0f);
  const float v11 = v7 + v10;
  const float v12 = v5 / v11;
  const float v13 = a0[0] + v12;
  const float v14 = (v2 != 0.0f ? v13 : 0.0f);
  const float v15 = (float)(0.0f < a1[1]);
  const float v18 = a0[2] * a2[0];
  const float v19 = a0[0] + v18;
  const float v23 = a0[5] + a2[0];
  const float v24 = a0[3] * v23;
  const float v25 = v24 * v23;
  const float v27 = (float)(0.0f < a0[1]);
  const float v28 = (float)(v27 == 0.0f);
  const float v30 = (v28 != 0.0f ? a0[4] : 0.0f);
  const float v31 = v25 + v30;
  const float v33 = 2.0f * a1[2];
  const float v34 = v31 + v33;
  const float v35 = 36.0f * v34;
  const float v36 = a1[0] - v19;
  const float v37 = v36 * v36;
  const float v38 = (float)(v35 < v37);
  const float v39 = (float)(v38 != 0.0f && v15 != 0.0f);
  const float v43 = a2[0] - 0.025f;
  const float v44 = larger(v43, 0.0f);
  const float v45 = a0[1] + v44;
  const float v46 = 4.60517019f * v45;
  const float v48 = (float)(0.0f < a1[6]);
  const float v50 = (v48 != 0.0f ? 0.02f : 0.0f);
  const float v51 = (float)(v48 == 0.0f);
  const float v53 = (v51 != 0.0f ? 0.05f : 0.0f);
  const float v54 = v50 + v53;
  const float v55 = v46 / v54;
  const float v56 = (-2.19722458f) + v55;
  const float v58 = smaller(v56, 50.0f);
  const float v61 = a1[7] * v36;
  const float v62 = a1[5] * v61;
  const float v63 = v61 * v61;
  const float v65 = larger(v63, 0.0f);
  const float v66 = v62 / v65;
  const float v68 = larger(v66, 0.5f);
  const float v70 = smaller(v68, 2.0f);
  const float v71 = v70 * v61;
  const float v72 = v71 / 2.0f;
  const float v73 = a1[5] - v72;
  const float v74 = v73 * v71;
  const float v76 = v74 / a1[8];
  const float v78 = larger(v76, (-50.0f));
  const float v79 = smaller(v78, 50.0f);
  const float v80 = (v48 != 0.0f ? v79 : 0.0f);
  const float v81 = v58 + v80;
  const float v82 = -v81;
  const float v83 = expf(v82);
  const float v84 = 1.0f + v83;
  const float v85 = 1.0f / v84;
  const float v86 = (v39 != 0.0f ? v85 : 0.0f);
  const float v87 = (float)(v39 == 0.0f);
  const float v88 = (v87 != 0.0f ? 1.0f : 0.0f);
  const float v89 = v86 + v88;
  const float v90 = v89 * v36;
  const float v91 = v19 + v90;
  const float v92 = (v15 != 0.0f ? v91 : 0.0f);
  const float v93 = (float)(v15 == 0.0f);
  const float v94 = (v93 != 0.0f ? v19 : 0.0f);
  const float v95 = v92 + v94;
  const float v96 = (v8 != 0.0f ? v95 : 0.0f);
  const float v97 = v14 + v96;
  r0[0] = v97;
  const float v99 = a0[1] + a2[0];
  const float v100 = (v39 != 0.0f ? v99 : 0.0f);
  r0[1] = v100;
  const float v102 = a2[0] / 0.05f;
  const float v103 = -v102;
  const float v104 = expf(v103);
  const float v105 = (float)(a1[1] != 0.0f);
  const float v106 = 1.0f - v104;
  const float v107 = v106 * v89;
  const float v108 = (v105 != 0.0f ? v107 : 0.0f);
  const float v109 = v104 + v108;
  const float v110 = a0[2] * v109;
  const float v111 = (v2 != 0.0f ? a2[0] : 0.0f);
  const float v112 = (v8 != 0.0f ? v23 : 0.0f);
  const float v113 = v111 + v112;
  const float v114 = v113 / 0.025f;
  const float v115 = -v114;
  const float v116 = expf(v115);
  const float v117 = 1.0f - v116;
  const float v118 = v89 * v117;
  const float v119 = v97 - a0[0];
  const float v120 = (float)(0.0f < a2[0]);
  const float v121 = (v120 != 0.0f ? a2[0] : 0.0f);
  const float v122 = (float)(v120 == 0.0f);
  const float v123 = (v122 != 0.0f ? 1.0f : 0.0f);
  const float v124 = v121 + v123;
  const float v125 = v119 / v124;
  const float v126 = (v2 != 0.0f ? v125 : 0.0f);
  const float v127 = (float)(0.0f < v113);
  const float v128 = (v127 != 0.0f ? v113 : 0.0f);
  const float v129 = (float)(v127 == 0.0f);
  const float v130 = (v129 != 0.0f ? 1.0f : 0.0f);
  const float v131 = v128 + v130;
  const float v132 = v36 / v131;
  const float v133 = a0[2] + v132;
  const float v134 = (v8 != 0.0f ? v133 : 0.0f);
  const float v135 = v126 + v134;
  const float v136 = v135 - a0[2];
  const float v137 = v118 * v136;
  const float v138 = (v105 != 0.0f ? v137 : 0.0f);
  const float v139 = v110 + v138;
  r0[2] = v139;
  const float v141 = v135 * v135;
  const float v142 = v141 - a0[3];
  const float v143 = v118 * v142;
  const float v144 = (v105 != 0.0f ? v143 : 0.0f);
  const float v145 = a0[3] + v144;
  r0[3] = v145;
  const float v147 = v119 * v119;
  const float v148 = (v2 != 0.0f ? v147 : 0.0f);
  const float v149 = 1.0f - v89;
  const float v150 = (v48 != 0.0f ? v89 : 0.0f);
  const float v152 = larger(v89, 0.25f);
  const float v153 = (v51 != 0.0f ? v152 : 0.0f);
  const float v154 = v150 + v153;
  const float v155 = v149 * v154;
  const float v156 = v155 * v37;
  const float v157 = (v39 != 0.0f ? v156 : 0.0f);
  const float v158 = (v15 != 0.0f ? v157 : 0.0f);
  const float v159 = v25 + a1[2];
  const float v160 = larger(a0[4], v159);
  const float v163 = v23 - a1[3];
  const float v164 = larger(v163, 0.0f);
  const float v165 = a1[4] * v164;
  const float v166 = v165 * v165;
  const float v167 = larger(v160, v166);
  const float v168 = (v93 != 0.0f ? v167 : 0.0f);
  const float v169 = v158 + v168;
  const float v170 = (v8 != 0.0f ? v169 : 0.0f);
  const float v171 = v148 + v170;
  r0[4] = v171;
  const float v173 = (v105 != 0.0f ? v89 : 0.0f);
  const float v174 = (float)(0.5f < v173);
  const float v175 = (float)(v174 == 0.0f);
  const float v176 = (v175 != 0.0f ? v23 : 0.0f);
  r0[5] = v176;
  const float v178 = v119 - v18;
  const float v179 = (v174 != 0.0f ? v178 : 0.0f);
  r0[6] = v179;
  const float v181 = a1[2] + v171;
  const float v183 = 0.12f * v178;
  const float v184 = v183 * v183;
  const float v185 = (v174 != 0.0f ? v184 : 0.0f);
  const float v186 = (v174 != 0.0f ? v185 : 0.0f);
  const float v187 = v181 + v186;
  r0[7] = v187;
}

static void track(const float* restrict a0, const float* restrict a1, const float* restrict a2, const float* restrict a3, float* restrict r0) {
  float w[17];
  int i;
  readings(a0, a1, a2, a3, w);
  drive(a1, w, a2, w + 9);
  for (i = 0; i < 6; ++i) r0[i] = w[9 + i];
  r0[6] = w[15];
  r0[7] = w[16];
}

static void interval(const float* restrict a0, const float* restrict a1, const float* restrict a2, const float* restrict a3, const float* restrict a4, const float* restrict a5, float* restrict r0, float* restrict r1, float* restrict r2, float* restrict r3, float* restrict r4, float* restrict r5, float* restrict r6) {
  (void)a1;
  (void)r3;
  r0[0] = a2[0];
  const float v4 = (float)(0.0f < a4[0]);
  const float v6 = a3[0] - a2[0];
  const float v7 = (v4 != 0.0f ? a4[0] : 0.0f);
  const float v8 = (float)(v4 == 0.0f);
  const float v10 = (v8 != 0.0f ? 1.0f : 0.0f);
  const float v11 = v7 + v10;
  const float v12 = v6 / v11;
  const float v13 = (v4 != 0.0f ? v12 : 0.0f);
  r1[0] = v13;
  r2[0] = 0.0f;
  r4[0] = 0.0f;
  r5[0] = a5[0];
  r5[1] = a5[1];
  r5[2] = a0[2];
  r5[3] = a5[3];
  r5[4] = a5[4];
  r5[5] = a5[5];
  r5[6] = a5[6];
  r5[7] = a0[3];
  r5[8] = a0[4];
  r5[9] = a5[9];
  const float v39 = a5[10] * a0[7];
  r5[10] = v39;
  r5[11] = a5[11];
  r5[12] = a0[5];
  r5[13] = a5[13];
  const float v48 = a5[14] * a0[7];
  r5[14] = v48;
  r5[15] = a5[15];
  r5[16] = a0[6];
  r5[17] = a5[17];
  const float v57 = a4[0] / 4.0f;
  const float v58 = a5[1] * v57;
  const float v59 = v58 / a5[0];
  const float v60 = -v59;
  const float v61 = expf(v60);
  r6[0] = v61;
  const float v63 = a5[6] * v57;
  const float v64 = v63 / a5[4];
  const float v65 = -v64;
  const float v66 = expf(v65);
  r6[1] = v66;
  const float v68 = v57 / a5[0];
  const float v70 = (float)(v59 < 1e-05f);
  const float v72 = v59 / 2.0f;
  const float v73 = 1.0f - v72;
  const float v74 = v59 * v59;
  const float v76 = v74 / 6.0f;
  const float v77 = v73 + v76;
  const float v78 = (v70 != 0.0f ? v77 : 0.0f);
  const float v79 = (float)(v70 == 0.0f);
  const float v80 = expm1f(v60);
  const float v81 = (v70 != 0.0f ? 1.0f : 0.0f);
  const float v82 = (v79 != 0.0f ? v59 : 0.0f);
  const float v83 = v81 + v82;
  const float v84 = v80 / v83;
  const float v85 = -v84;
  const float v86 = (v79 != 0.0f ? v85 : 0.0f);
  const float v87 = v78 + v86;
  const float v88 = v68 * v87;
  r6[2] = v88;
  const float v90 = v57 / a5[4];
  const float v91 = (float)(v64 < 1e-05f);
  const float v92 = v64 / 2.0f;
  const float v93 = 1.0f - v92;
  const float v94 = v64 * v64;
  const float v95 = v94 / 6.0f;
  const float v96 = v93 + v95;
  const float v97 = (v91 != 0.0f ? v96 : 0.0f);
  const float v98 = (float)(v91 == 0.0f);
  const float v99 = expm1f(v65);
  const float v100 = (v91 != 0.0f ? 1.0f : 0.0f);
  const float v101 = (v98 != 0.0f ? v64 : 0.0f);
  const float v102 = v100 + v101;
  const float v103 = v99 / v102;
  const float v104 = -v103;
  const float v105 = (v98 != 0.0f ? v104 : 0.0f);
  const float v106 = v97 + v105;
  const float v107 = v90 * v106;
  r6[3] = v107;
  r6[4] = 0.0f;
  r6[5] = 0.0f;
  r6[6] = 0.0f;
  r6[7] = 0.0f;
}

static void substep(const float* restrict a0, const float* restrict a1, const float* restrict a2, const float* restrict a3, const float* restrict a4, const float* restrict a5, const float* restrict a6, const float* restrict a7, float* restrict r0, float* restrict r1, float* restrict r2, float* restrict r3, float* restrict r4, float* restrict r5) {
  (void)a4;
  const float v5 = a5[2] * a5[3];
  const float v10 = a5[5] * a0[1];
  const float v12 = a5[9] * a0[0];
  const float v13 = v10 - v12;
  const float v14 = a5[10] * v13;
  const float v16 = v14 + a5[12];
  const float v17 = (float)(0.0f < v16);
  const float v20 = a5[5] * a1[1];
  const float v22 = a5[9] * a1[0];
  const float v23 = v20 - v22;
  const float v24 = a5[11] * v23;
  const float v25 = v16 + v24;
  const float v26 = (float)(0.0f < v25);
  const float v27 = (float)(v17 != 0.0f && v26 != 0.0f);
  const float v28 = (v27 != 0.0f ? v25 : 0.0f);
  const float v31 = a5[13] * a0[0];
  const float v32 = v31 - v10;
  const float v33 = a5[14] * v32;
  const float v35 = v33 + a5[16];
  const float v36 = (float)(0.0f < v35);
  const float v38 = a5[13] * a1[0];
  const float v39 = v38 - v20;
  const float v40 = a5[15] * v39;
  const float v41 = v35 + v40;
  const float v42 = (float)(0.0f < v41);
  const float v43 = (float)(v36 != 0.0f && v42 != 0.0f);
  const float v44 = (v43 != 0.0f ? v41 : 0.0f);
  const float v45 = v28 + v44;
  const float v46 = v5 * v45;
  const float v47 = a6[2] * v46;
  const float v49 = a6[0] * a1[0];
  const float v51 = a5[9] * v25;
  const float v52 = -v51;
  const float v53 = (v27 != 0.0f ? v52 : 0.0f);
  const float v54 = a5[13] * v41;
  const float v55 = (v43 != 0.0f ? v54 : 0.0f);
  const float v56 = v53 + v55;
  const float v57 = a2[0] - v56;
  const float v58 = (float)(0.0f < v28);
  const float v59 = a5[9] * a5[9];
  const float v60 = a5[11] * v59;
  const float v61 = (v58 != 0.0f ? v60 : 0.0f);
  const float v62 = (float)(0.0f < v44);
  const float v63 = a5[13] * a5[13];
  const float v64 = a5[15] * v63;
  const float v65 = (v62 != 0.0f ? v64 : 0.0f);
  const float v66 = v61 + v65;
  const float v67 = v66 * a1[0];
  const float v68 = v57 + v67;
  const float v69 = a6[2] * v68;
  const float v70 = v49 + v69;
  const float v71 = (float)(v47 <= v70);
  const float v72 = -v47;
  const float v73 = (float)(v70 < v72);
  const float v74 = v71 + v73;
  const float v75 = v74 * v70;
  const float v76 = v71 - v73;
  const float v77 = v76 * v47;
  const float v78 = v75 - v77;
  const float v80 = a6[2] * v66;
  const float v81 = 1.0f + v80;
  const float v82 = v78 / v81;
  const float v83 = a3[0] * v82;
  const float v84 = a0[0] + v83;
  r0[0] = v84;
  const float v86 = a3[0] * a1[1];
  const float v87 = a0[1] + v86;
  r0[1] = v87;
  r1[0] = v82;
  r1[1] = a1[1];
  const float v91 = a5[10] * a5[9];
  const float v92 = a5[9] * v91;
  const float v93 = (v27 != 0.0f ? v92 : 0.0f);
  const float v94 = a5[14] * a5[13];
  const float v95 = a5[13] * v94;
  const float v96 = (v43 != 0.0f ? v95 : 0.0f);
  const float v97 = v93 + v96;
  const float v98 = a6[2] * v97;
  const float v99 = v74 * v98;
  const float v100 = -v91;
  const float v101 = (v27 != 0.0f ? v100 : 0.0f);
  const float v102 = (v43 != 0.0f ? v94 : 0.0f);
  const float v103 = v101 + v102;
  const float v104 = v5 * v103;
  const float v105 = a6[2] * v104;
  const float v106 = v76 * v105;
  const float v107 = v99 + v106;
  const float v108 = v107 / v81;
  const float v109 = -v108;
  r2[0] = v109;
  const float v111 = a5[11] * a5[9];
  const float v112 = a5[9] * v111;
  const float v113 = (v27 != 0.0f ? v112 : 0.0f);
  const float v114 = a5[15] * a5[13];
  const float v115 = a5[13] * v114;
  const float v116 = (v43 != 0.0f ? v115 : 0.0f);
  const float v117 = v113 + v116;
  const float v118 = v66 - v117;
  const float v119 = a6[2] * v118;
  const float v120 = a6[0] + v119;
  const float v121 = v74 * v120;
  const float v122 = -v111;
  const float v123 = (v27 != 0.0f ? v122 : 0.0f);
  const float v124 = (v43 != 0.0f ? v114 : 0.0f);
  const float v125 = v123 + v124;
  const float v126 = v5 * v125;
  const float v127 = a6[2] * v126;
  const float v128 = v76 * v127;
  const float v129 = v121 - v128;
  const float v130 = v129 / v81;
  r3[0] = v130;
  r4[0] = 0.0f;
  r4[1] = 0.0f;
  const float v134 = v76 / v81;
  const float v135 = a6[2] * v134;
  const float v136 = v45 * v135;
  const float v137 = a5[3] * v136;
  const float v138 = -v137;
  r4[2] = v138;
  r4[3] = 0.0f;
  r4[4] = 0.0f;
  const float v142 = v74 / v81;
  const float v143 = a6[2] * v142;
  const float v144 = a5[9] * v143;
  const float v145 = v5 * v135;
  const float v146 = v144 - v145;
  const float v147 = (v27 != 0.0f ? v146 : 0.0f);
  r4[5] = v147;
  const float v149 = a5[13] * v143;
  const float v150 = v149 + v145;
  const float v151 = -v150;
  const float v152 = (v43 != 0.0f ? v151 : 0.0f);
  r4[6] = v152;
  const float v154 = v13 * v146;
  const float v156 = v154 * a7[10];
  const float v157 = (v27 != 0.0f ? v156 : 0.0f);
  const float v158 = v32 * v150;
  const float v160 = v158 * a7[14];
  const float v161 = -v160;
  const float v162 = (v43 != 0.0f ? v161 : 0.0f);
  const float v163 = v157 + v162;
  r4[7] = v163;
  const float v165 = a5[10] * a5[5];
  const float v166 = a5[9] * v165;
  const float v167 = -v166;
  const float v168 = (v27 != 0.0f ? v167 : 0.0f);
  const float v169 = a5[14] * a5[5];
  const float v170 = a5[13] * v169;
  const float v171 = -v170;
  const float v172 = (v43 != 0.0f ? v171 : 0.0f);
  const float v173 = v168 + v172;
  const float v174 = a6[2] * v173;
  const float v175 = v74 * v174;
  const float v176 = (v27 != 0.0f ? v165 : 0.0f);
  const float v177 = -v169;
  const float v178 = (v43 != 0.0f ? v177 : 0.0f);
  const float v179 = v176 + v178;
  const float v180 = v5 * v179;
  const float v181 = a6[2] * v180;
  const float v182 = v76 * v181;
  const float v183 = v175 + v182;
  const float v184 = v183 / v81;
  const float v185 = -v184;
  r4[8] = v185;
  r5[0] = 0.0f;
}

static void rows(const float* restrict a0, const float* restrict a1, const float* restrict a2, const float* restrict a3, const float* restrict a4, float* restrict r0, float* restrict r1, float* restrict r2, float* restrict r3) {
  (void)r3;
  const float v3 = a4[6] * a2[0];
  const float v7 = a4[10] * a0[7];
  const float v10 = a4[5] * a1[0];
  const float v13 = a4[9] * a0[0];
  const float v14 = v10 - v13;
  const float v15 = v7 * v14;
  const float v17 = v15 + a0[5];
  const float v18 = (float)(0.0f < v17);
  const float v20 = a4[5] * a2[0];
  const float v22 = a4[9] * a0[1];
  const float v23 = v20 - v22;
  const float v24 = a4[11] * v23;
  const float v25 = v17 + v24;
  const float v26 = (float)(0.0f < v25);
  const float v27 = (float)(v18 != 0.0f && v26 != 0.0f);
  const float v28 = a4[5] * v25;
  const float v29 = (v27 != 0.0f ? v28 : 0.0f);
  const float v31 = a4[14] * a0[7];
  const float v33 = a4[13] * a0[0];
  const float v34 = v33 - v10;
  const float v35 = v31 * v34;
  const float v37 = v35 + a0[6];
  const float v38 = (float)(0.0f < v37);
  const float v40 = a4[13] * a0[1];
  const float v41 = v40 - v20;
  const float v42 = a4[15] * v41;
  const float v43 = v37 + v42;
  const float v44 = (float)(0.0f < v43);
  const float v45 = (float)(v38 != 0.0f && v44 != 0.0f);
  const float v46 = a4[5] * v43;
  const float v47 = -v46;
  const float v48 = (v45 != 0.0f ? v47 : 0.0f);
  const float v49 = v29 + v48;
  const float v50 = v3 + v49;
  const float v51 = a3[2] - v50;
  r0[0] = v51;
  const float v55 = a0[4] * a4[5];
  const float v56 = (v27 != 0.0f ? v25 : 0.0f);
  const float v57 = (v45 != 0.0f ? v43 : 0.0f);
  const float v58 = v56 + v57;
  const float v59 = v55 * v58;
  const float v60 = a0[3] + v59;
  r0[1] = v60;
  r0[2] = 0.0f;
  const float v68 = a1[5] + 0.05f;
  const float v69 = a1[5] / v68;
  const float v70 = v69 * v69;
  const float v71 = v69 * v70;
  const float v72 = 20.0f * v71;
  const float v74 = v72 * a1[4];
  const float v75 = a1[7] + v74;
  const float v76 = v7 * a4[5];
  const float v77 = a4[5] * v76;
  const float v78 = (v27 != 0.0f ? v77 : 0.0f);
  const float v79 = v31 * a4[5];
  const float v80 = a4[5] * v79;
  const float v81 = (v45 != 0.0f ? v80 : 0.0f);
  const float v82 = v78 + v81;
  const float v83 = v82 * v82;
  const float v84 = v75 * v83;
  const float v85 = 2.5e-05f + v84;
  r0[3] = v85;
  r0[4] = a3[4];
  const float v89 = a4[13] * v79;
  const float v90 = (v45 != 0.0f ? v89 : 0.0f);
  const float v91 = a4[9] * v76;
  const float v92 = (v27 != 0.0f ? v91 : 0.0f);
  const float v93 = v90 + v92;
  r1[0] = v93;
  const float v95 = a4[15] * a4[5];
  const float v96 = a4[13] * v95;
  const float v97 = (v45 != 0.0f ? v96 : 0.0f);
  const float v98 = a4[11] * a4[5];
  const float v99 = a4[9] * v98;
  const float v100 = (v27 != 0.0f ? v99 : 0.0f);
  const float v101 = v97 + v100;
  r1[1] = v101;
  const float v103 = -a4[5];
  const float v104 = (v27 != 0.0f ? v103 : 0.0f);
  r1[2] = v104;
  const float v106 = (v45 != 0.0f ? a4[5] : 0.0f);
  r1[3] = v106;
  const float v108 = v34 * a4[5];
  const float v109 = a4[14] * v108;
  const float v110 = (v45 != 0.0f ? v109 : 0.0f);
  const float v111 = v14 * a4[5];
  const float v112 = a4[10] * v111;
  const float v113 = -v112;
  const float v114 = (v27 != 0.0f ? v113 : 0.0f);
  const float v115 = v110 + v114;
  r1[4] = v115;
  const float v117 = v31 * v55;
  const float v118 = a4[13] * v117;
  const float v119 = (v45 != 0.0f ? v118 : 0.0f);
  const float v120 = v7 * v55;
  const float v121 = a4[9] * v120;
  const float v122 = -v121;
  const float v123 = (v27 != 0.0f ? v122 : 0.0f);
  const float v124 = v119 + v123;
  r2[0] = v124;
  const float v126 = a4[15] * v55;
  const float v127 = a4[13] * v126;
  const float v128 = (v45 != 0.0f ? v127 : 0.0f);
  const float v129 = a4[11] * v55;
  const float v130 = a4[9] * v129;
  const float v131 = -v130;
  const float v132 = (v27 != 0.0f ? v131 : 0.0f);
  const float v133 = v128 + v132;
  r2[1] = v133;
  r2[2] = 1.0f;
  const float v137 = a4[5] * v58;
  r2[3] = v137;
  const float v139 = (v27 != 0.0f ? v55 : 0.0f);
  r2[4] = v139;
  const float v141 = (v45 != 0.0f ? v55 : 0.0f);
  r2[5] = v141;
  const float v143 = v34 * v55;
  const float v144 = a4[14] * v143;
  const float v145 = (v45 != 0.0f ? v144 : 0.0f);
  const float v146 = v14 * v55;
  const float v147 = a4[10] * v146;
  const float v148 = (v27 != 0.0f ? v147 : 0.0f);
  const float v149 = v145 + v148;
  r2[6] = v149;
}

static void corner(const float* restrict a0, const float* restrict a1, const float* restrict a2, const float* restrict a3, const float* restrict a4, const float* restrict a5, const float* restrict a6, float* restrict r0) {
  (void)a6;
  const float v2 = a1[0] * a1[0];
  const float v4 = v2 * a3[7];
  const float v5 = a0[0] + v4;
  const float v9 = a3[5] + 0.05f;
  const float v10 = a3[5] / v9;
  const float v11 = v10 * v10;
  const float v12 = v10 * v11;
  const float v15 = a3[4] - a4[4];
  const float v17 = larger(v15, 0.0f);
  const float v18 = v12 * v17;
  const float v19 = 0.390625f * v18;
  const float v20 = v5 + v19;
  r0[0] = v20;
  const float v24 = a1[0] * a1[1];
  const float v25 = v24 * a3[7];
  const float v26 = a0[2] + v25;
  r0[1] = v26;
  r0[2] = v26;
  const float v30 = a1[1] * a1[1];
  const float v31 = v30 * a3[7];
  const float v32 = a0[3] + v31;
  const float v36 = 0.25f * a5[0];
  const float v37 = a2[0] + v36;
  const float v38 = v32 + v37;
  r0[3] = v38;
}

static void compare(const float* restrict a0, const float* restrict a1, const float* restrict a2, const float* restrict a3, const float* restrict a4, float* restrict r0, float* restrict r1, float* restrict r2, float* restrict r3, float* restrict r4, float* restrict r5) {
  (void)a4;
  const float v4 = 0.0001f * a2[3];
  const float v9 = larger(a3[0], 1e-06f);
  const float v10 = 0.01f / v9;
  const float v11 = v10 * v10;
  const float v12 = 2.48770893e-07f * v11;
  const float v13 = v4 - v12;
  const float v15 = larger(v13, 0.0f);
  const float v17 = 0.01f * a2[2];
  const float v18 = v17 * v17;
  const float v19 = larger(v15, v18);
  const float v20 = v19 + 4.47787607e-08f;
  const float v21 = 4.47787607e-08f / v20;
  const float v22 = (float)(0.5f < v21);
  const float v25 = a0[1] + a1[1];
  const float v26 = larger(v25, 0.0f);
  const float v28 = (float)(0.0f < a0[4]);
  const float v30 = a3[0] / 0.1f;
  const float v31 = -v30;
  const float v32 = expf(v31);
  const float v34 = v32 * a1[5];
  const float v36 = 1.0f - v32;
  const float v39 = a0[0] + a1[0];
  const float v40 = v36 * v39;
  const float v41 = v34 + v40;
  const float v42 = (v28 != 0.0f ? v41 : 0.0f);
  const float v43 = (float)(v28 == 0.0f);
  const float v44 = (v43 != 0.0f ? a1[5] : 0.0f);
  const float v45 = v42 + v44;
  const float v46 = (float)((v45 > 0.0f) - (v45 < 0.0f));
  const float v49 = a0[2] + a1[2];
  const float v50 = v46 * v49;
  const float v51 = v26 + v50;
  const float v52 = fabsf(v45);
  const float v53 = (float)(v51 < v52);
  const float v54 = v46 * v51;
  const float v55 = v45 - v54;
  const float v56 = (v53 != 0.0f ? v55 : 0.0f);
  const float v57 = (v22 != 0.0f ? v56 : 0.0f);
  const float v58 = (float)(v22 == 0.0f);
  const float v59 = sqrtf(v20);
  const float v60 = v17 / v59;
  const float v62 = a2[6] * a2[6];
  const float v64 = v62 / 1.24385446e-05f;
  const float v65 = 1.0f + v64;
  const float v66 = v60 / v65;
  const float v67 = v66 * v26;
  const float v68 = v39 - v67;
  const float v69 = fabsf(v66);
  const float v70 = v69 * v49;
  const float v71 = v68 - v70;
  const float v72 = (v58 != 0.0f ? v71 : 0.0f);
  const float v73 = v57 + v72;
  r0[0] = v73;
  const float v76 = (v53 != 0.0f ? a0[3] : 0.0f);
  const float v77 = (float)(v53 == 0.0f);
  const float v79 = 0.42f * v26;
  const float v80 = v79 * v79;
  const float v81 = v80 + a0[3];
  const float v83 = v81 + a1[4];
  const float v84 = 1.0f / v83;
  const float v87 = larger(a1[3], 1e-12f);
  const float v88 = 1.0f / v87;
  const float v89 = v84 - v88;
  const float v91 = larger(v89, 1e-09f);
  const float v92 = 1.0f / v91;
  const float v93 = (v77 != 0.0f ? v92 : 0.0f);
  const float v94 = v76 + v93;
  const float v95 = (v22 != 0.0f ? v94 : 0.0f);
  const float v97 = 100.0f * v21;
  const float v99 = 1.0f - v21;
  const float v100 = v66 * v66;
  const float v101 = 1.0f - v100;
  const float v102 = v99 * v101;
  const float v103 = 60.0f * v102;
  const float v104 = v97 + v103;
  const float v105 = v26 * v26;
  const float v106 = v105 + a1[4];
  const float v107 = v104 * v106;
  const float v108 = a0[3] + v107;
  const float v109 = (v58 != 0.0f ? v108 : 0.0f);
  const float v110 = v95 + v109;
  r1[0] = v110;
  r2[0] = v45;
  const float v113 = (v53 != 0.0f ? v46 : 0.0f);
  const float v114 = (v22 != 0.0f ? v113 : 0.0f);
  const float v115 = (v58 != 0.0f ? v66 : 0.0f);
  const float v116 = v114 + v115;
  r3[0] = v116;
  const float v118 = (v53 != 0.0f ? 1.0f : 0.0f);
  const float v119 = (v22 != 0.0f ? v118 : 0.0f);
  const float v120 = (v58 != 0.0f ? v69 : 0.0f);
  const float v121 = v119 + v120;
  r4[0] = v121;
  r5[0] = 1.0f;
}

static void weights(const float* restrict a0, const float* restrict a1, const float* restrict a2, const float* restrict a3, float* restrict r0, float* restrict r1, float* restrict r2) {
  const float v2 = larger(a2[0], 0.0f);
  const float v5 = larger(a0[0], 1e-30f);
  const float v8 = a1[0] * a1[0];
  const float v10 = 9.0f * v5;
  const float v11 = v8 / v10;
  const float v12 = larger(1.0f, v11);
  const float v13 = v5 * v12;
  const float v14 = v2 / v13;
  r0[0] = v14;
  const float v16 = sqrtf(v14);
  r1[0] = v16;
  const float v18 = (float)(a2[0] != 0.0f);
  const float v20 = (float)(v18 != 0.0f && a3[0] != 0.0f);
  const float v21 = (v20 != 0.0f ? a1[0] : 0.0f);
  const float v22 = (float)(v20 == 0.0f);
  const float v24 = (v22 != 0.0f ? NAN : 0.0f);
  const float v25 = v21 + v24;
  r2[0] = v25;
}

static void adaptive(float* restrict state, const float* restrict a1, const float* restrict a2, float* restrict r1) {
  static const float c0[9] = {0.0f, 1.0f, 0.0f, 0.0f, 0.0f, 0.0f, 0.0f, 0.0f, 0.0f};
  static const float c1[9] = {1.0f, 0.0f, 0.0f, 0.0f, 0.0f, 0.0f, 0.0f, 0.0f, 0.0f};
  static const unsigned short t2[4] = {0, 1, 8, 9};
  static const float c3[6] = {9.86666788e-07f, 1.43259045e-08f, 1.52895095e-07f, 0.0064f, 0.0064f, 9e-06f};
  static const unsigned short t4[5] = {0, 1, 5, 6, 7};
  static const unsigned short t5[7] = {0, 1, 3, 4, 5, 6, 7};
  static const unsigned short t6[36] = {18, 19, 20, 21, 22, 23, 26, 27, 28, 29, 30, 31, 34, 35, 36, 37, 38, 39, 42, 43, 44, 45, 46, 47, 50, 51, 52, 53, 54, 55, 58, 59, 60, 61, 62, 63};
  float w[155];
  int i;
  int j;
  int k;
  track(state, state + 72, a1, a2, w + 117);
  interval(state, state + 8, state + 72, w + 117, a1, a2, w + 28, w + 34, w + 35, 0, w + 36, w, w + 18);
  w[26] = state[0];
  w[27] = w[28];
  w[28] = state[1];
  w[29] = w[34];
  w[142] = a1[0] / 4.0f;
  substep(w + 26, w + 28, w + 35, w + 142, w + 36, w, w + 18, a2, w + 30, w + 32, w + 143, w + 144, w + 72, w + 145);
  substep(w + 30, w + 32, w + 35, w + 142, w + 36, w, w + 18, a2, w + 26, w + 28, w + 146, w + 147, w + 81, w + 148);
  substep(w + 26, w + 28, w + 35, w + 142, w + 36, w, w + 18, a2, w + 30, w + 32, w + 149, w + 150, w + 90, w + 151);
  substep(w + 30, w + 32, w + 35, w + 142, w + 36, w, w + 18, a2, w + 26, w + 28, w + 152, w + 153, w + 99, w + 154);
  state[0] = w[26];
  state[1] = w[28];
  rows(state, w + 117, w + 34, a1, a2, w + 132, w + 137, w + 125, 0);
  for (i = 0; i < 64; ++i) w[i] = state[8 + i];
  for (i = 0; i < 8; ++i) w[64 + i] = 0.0f;
  for (i = 0; i < 9; ++i) w[108 + i] = c0[i] * w[144];
  for (i = 0; i < 9; ++i) w[72 + i] = w[72 + i] + w[108 + i];
  for (i = 0; i < 9; ++i) w[108 + i] = c1[i] * w[143];
  for (i = 0; i < 9; ++i) w[72 + i] = w[72 + i] + w[108 + i];
  for (i = 0; i < 9; ++i) w[108 + i] = w[142] * w[72 + i];
  for (i = 0; i < 9; ++i) w[108 + i] = c1[i] + w[108 + i];
  for (i = 0; i < 9; ++i) w[72 + i] = w[72 + i] * w[147];
  for (i = 0; i < 9; ++i) w[81 + i] = w[81 + i] + w[72 + i];
  for (i = 0; i < 9; ++i) w[72 + i] = w[108 + i] * w[146];
  for (i = 0; i < 9; ++i) w[81 + i] = w[81 + i] + w[72 + i];
  for (i = 0; i < 9; ++i) w[72 + i] = w[142] * w[81 + i];
  for (i = 0; i < 9; ++i) w[108 + i] = w[108 + i] + w[72 + i];
  for (i = 0; i < 9; ++i) w[81 + i] = w[81 + i] * w[150];
  for (i = 0; i < 9; ++i) w[90 + i] = w[90 + i] + w[81 + i];
  for (i = 0; i < 9; ++i) w[72 + i] = w[108 + i] * w[149];
  for (i = 0; i < 9; ++i) w[90 + i] = w[90 + i] + w[72 + i];
  for (i = 0; i < 9; ++i) w[72 + i] = w[142] * w[90 + i];
  for (i = 0; i < 9; ++i) w[108 + i] = w[108 + i] + w[72 + i];
  for (i = 0; i < 9; ++i) w[90 + i] = w[90 + i] * w[153];
  for (i = 0; i < 9; ++i) w[99 + i] = w[99 + i] + w[90 + i];
  for (i = 0; i < 9; ++i) w[72 + i] = w[108 + i] * w[152];
  for (i = 0; i < 9; ++i) w[99 + i] = w[99 + i] + w[72 + i];
  for (i = 0; i < 9; ++i) w[72 + i] = w[142] * w[99 + i];
  for (i = 0; i < 9; ++i) w[108 + i] = w[108 + i] + w[72 + i];
  for (i = 0; i < 9; ++i) w[72 + i] = w[108 + i];
  for (i = 0; i < 9; ++i) w[81 + i] = w[99 + i];
  for (j = 0; j < 2; j += 2) for (i = 0; i < 8; ++i) { float s0 = 0.0f, s1 = 0.0f; { const float e = w[i]; s0 += e * w[72 + 0 + 9 * j]; s1 += e * w[72 + 0 + 9 + 9 * j]; } { const float e = w[i + 8]; s0 += e * w[72 + 1 + 9 * j]; s1 += e * w[72 + 1 + 9 + 9 * j]; } { const float e = w[i + 16]; s0 += e * w[72 + 2 + 9 * j]; s1 += e * w[72 + 2 + 9 + 9 * j]; } { const float e = w[i + 24]; s0 += e * w[72 + 3 + 9 * j]; s1 += e * w[72 + 3 + 9 + 9 * j]; } { const float e = w[i + 32]; s0 += e * w[72 + 4 + 9 * j]; s1 += e * w[72 + 4 + 9 + 9 * j]; } { const float e = w[i + 40]; s0 += e * w[72 + 5 + 9 * j]; s1 += e * w[72 + 5 + 9 + 9 * j]; } { const float e = w[i + 48]; s0 += e * w[72 + 6 + 9 * j]; s1 += e * w[72 + 6 + 9 + 9 * j]; } { const float e = w[i + 56]; s0 += e * w[72 + 7 + 9 * j]; s1 += e * w[72 + 7 + 9 + 9 * j]; } { const float e = w[i + 64]; s0 += e * w[72 + 8 + 9 * j]; s1 += e * w[72 + 8 + 9 + 9 * j]; } w[90 + i + 8 * j] = s0; w[90 + i + 8 + 8 * j] = s1; }
  for (i = 0; i < 8; ++i) state[8 + 0 + 1 * i] = w[90 + i];
  for (i = 0; i < 8; ++i) state[8 + 0 + 8 * i] = w[90 + i];
  state[8] = w[90];
  for (i = 0; i < 8; ++i) state[8 + 8 + 1 * i] = w[98 + i];
  for (i = 0; i < 8; ++i) state[8 + 1 + 8 * i] = w[98 + i];
  state[17] = w[99];
  for (i = 0; i < 2; ++i) for (j = 0; j < 8; ++j) w[18 + i + 2 * j] = w[90 + j + 8 * i];
  for (i = 0; i < 16; ++i) w[i] = w[18 + i];
  w[16] = 0.0f;
  w[17] = 0.0f;
  for (j = 0; j < 2; j += 2) for (i = 0; i < 2; ++i) { float s0 = 0.0f, s1 = 0.0f; { const float e = w[i]; s0 += e * w[72 + 0 + 9 * j]; s1 += e * w[72 + 0 + 9 + 9 * j]; } { const float e = w[i + 2]; s0 += e * w[72 + 1 + 9 * j]; s1 += e * w[72 + 1 + 9 + 9 * j]; } { const float e = w[i + 4]; s0 += e * w[72 + 2 + 9 * j]; s1 += e * w[72 + 2 + 9 + 9 * j]; } { const float e = w[i + 6]; s0 += e * w[72 + 3 + 9 * j]; s1 += e * w[72 + 3 + 9 + 9 * j]; } { const float e = w[i + 8]; s0 += e * w[72 + 4 + 9 * j]; s1 += e * w[72 + 4 + 9 + 9 * j]; } { const float e = w[i + 10]; s0 += e * w[72 + 5 + 9 * j]; s1 += e * w[72 + 5 + 9 + 9 * j]; } { const float e = w[i + 12]; s0 += e * w[72 + 6 + 9 * j]; s1 += e * w[72 + 6 + 9 + 9 * j]; } { const float e = w[i + 14]; s0 += e * w[72 + 7 + 9 * j]; s1 += e * w[72 + 7 + 9 + 9 * j]; } { const float e = w[i + 16]; s0 += e * w[72 + 8 + 9 * j]; s1 += e * w[72 + 8 + 9 + 9 * j]; } w[18 + i + 2 * j] = s0; w[18 + i + 2 + 2 * j] = s1; }
  w[4] = w[80];
  w[5] = w[89];
  w[145] = w[145] + w[148];
  w[145] = w[145] + w[151];
  w[145] = w[145] + w[154];
  corner(w + 18, w + 4, w + 145, w + 117, state + 72, a1, a2, w);
  for (i = 0; i < 4; ++i) state[8 + t2[i]] = w[i];
  for (i = 0; i < 6; ++i) w[i] = state[8 + 18 + 9 * i];
  for (i = 0; i < 6; ++i) w[6 + i] = c3[i] * a1[0];
  for (i = 0; i < 6; ++i) w[i] = w[i] + w[6 + i];
  for (i = 0; i < 6; ++i) state[8 + 18 + 9 * i] = w[i];
  for (i = 0; i < 8; ++i) w[i] = state[8 + i] * w[137] + state[8 + i + 8] * w[138] + state[8 + i + 40] * w[139] + state[8 + i + 48] * w[140] + state[8 + i + 56] * w[141];
  w[8] = 0.0f;
  for (k = 0; k < 5; ++k) w[8] += w[137 + k] * w[t4[k]];
  for (i = 0; i < 8; ++i) w[72 + i] = state[8 + i] * w[125] + state[8 + i + 8] * w[126] + state[8 + i + 24] * w[127] + state[8 + i + 32] * w[128] + state[8 + i + 40] * w[129] + state[8 + i + 48] * w[130] + state[8 + i + 56] * w[131];
  w[9] = 0.0f;
  for (k = 0; k < 7; ++k) w[9] += w[125 + k] * w[72 + t5[k]];
  w[16] = 0.0f;
  w[17] = 0.0f;
  w[18] = 0.0f;
  w[19] = w[8];
  w[20] = w[9];
  w[21] = state[78];
  for (i = 0; i < 6; ++i) w[8 + i] = w[117 + i];
  w[14] = w[123];
  w[15] = w[124];
  compare(w + 132, w + 16, w + 8, a1, a2, w + 22, w + 88, w + 89, w + 90, w + 23, w + 24);
  for (i = 0; i < 8; ++i) w[72 + i] = w[90] * w[72 + i];
  for (i = 0; i < 8; ++i) w[72 + i] = w[72 + i] - w[i];
  w[0] = 0.0f;
  for (k = 0; k < 7; ++k) w[0] += w[125 + k] * w[72 + t5[k]];
  w[90] = w[90] * w[0];
  w[0] = 0.0f;
  for (k = 0; k < 5; ++k) w[0] += w[137 + k] * w[72 + t4[k]];
  w[90] = w[90] - w[0];
  w[0] = w[90] + w[88];
  weights(w, w + 22, w + 136, w + 24, w + 1, w + 6, w + 91);
  w[1] = w[1] * w[22];
  for (i = 0; i < 8; ++i) w[80 + i] = w[1] * w[72 + i];
  for (i = 0; i < 6; ++i) w[i] = 0.0166666667f * w[82 + i];
  for (i = 0; i < 6; ++i) w[80 + 2 + 1 * i] = w[i];
  for (i = 0; i < 8; ++i) state[i] = state[i] + w[80 + i];
  w[0] = larger(0.000496655512f, state[2]);
  state[2] = w[0];
  w[0] = larger(5.98454354e-05f, state[3]);
  state[3] = w[0];
  w[0] = larger(0.000195509012f, state[4]);
  state[4] = w[0];
  w[0] = larger(0.04f, state[5]);
  state[5] = w[0];
  w[0] = larger(0.04f, state[6]);
  state[6] = w[0];
  w[0] = larger(0.05f, state[7]);
  state[7] = w[0];
  for (i = 0; i < 8; ++i) w[72 + i] = w[6] * w[72 + i];
  for (i = 0; i < 8; ++i) w[i] = -w[72 + i];
  for (j = 0; j < 8; j += 4) for (i = 0; i < 8; ++i) { float s0 = state[8 + i + 8 * j], s1 = state[8 + i + 8 + 8 * j], s2 = state[8 + i + 16 + 8 * j], s3 = state[8 + i + 24 + 8 * j]; { const float e = w[72 + i]; s0 += e * w[0 + 1 * j]; s1 += e * w[0 + 1 + 1 * j]; s2 += e * w[0 + 2 + 1 * j]; s3 += e * w[0 + 3 + 1 * j]; } state[8 + i + 8 * j] = s0; state[8 + i + 8 + 8 * j] = s1; state[8 + i + 16 + 8 * j] = s2; state[8 + i + 24 + 8 * j] = s3; }
  for (i = 0; i < 36; ++i) w[i] = state[8 + t6[i]];
  for (i = 0; i < 6; ++i) w[74 + i] = 0.983333333f * w[74 + i];
  for (j = 0; j < 4; j += 4) for (i = 0; i < 6; ++i) { float s0 = 0.0f, s1 = 0.0f, s2 = 0.0f, s3 = 0.0f; { const float e = w[74 + i]; s0 += e * w[74 + 0 + 1 * j]; s1 += e * w[74 + 0 + 1 + 1 * j]; s2 += e * w[74 + 0 + 2 + 1 * j]; s3 += e * w[74 + 0 + 3 + 1 * j]; } w[36 + i + 6 * j] = s0; w[36 + i + 6 + 6 * j] = s1; w[36 + i + 12 + 6 * j] = s2; w[36 + i + 18 + 6 * j] = s3; }
  for (j = 0; j < 2; j += 2) for (i = 0; i < 6; ++i) { float s0 = 0.0f, s1 = 0.0f; { const float e = w[74 + i]; s0 += e * w[74 + 0 + 4 + 1 * j]; s1 += e * w[74 + 0 + 5 + 1 * j]; } w[36 + i + 24 + 6 * j] = s0; w[36 + i + 30 + 6 * j] = s1; }
  for (i = 0; i < 36; ++i) w[i] = w[i] + w[36 + i];
  for (i = 0; i < 36; ++i) state[8 + t6[i]] = w[i];
  w[0] = 0.0f;
  for (k = 0; k < 5; ++k) w[0] += w[137 + k] * w[80 + t4[k]];
  w[89] = w[89] + w[0];
  r1[0] = w[91];
  w[90] = w[90] + w[88];
  r1[1] = w[90];
  for (i = 0; i < 6; ++i) state[72 + i] = w[117 + i];
  state[78] = w[89];
}

/* which of the values each innovation is of */
static const unsigned char measured[1] = {1};

static int is_there(float value) { return value == value; }

static float root(float variance) { return variance <= 0.0f ? 0.0f : sqrtf(variance); }

void capstan_adaptive_begin(capstan_adaptive_state* state, const float* values) {
  float known[2], mask[2], spread[8];
  int i;
  for (i = 0; i < 2; ++i) {
    mask[i] = is_there(values[i]) ? 1.0f : 0.0f;
    known[i] = is_there(values[i]) ? values[i] : 0.0f;
  }
  memset(state, 0, sizeof *state);
  prior(known, mask, numbers, state->carry, spread, state->carry + 8 + 8 * 8);
  for (i = 0; i < 8; ++i) state->carry[8 + i * 9] = spread[i];
}

void capstan_adaptive_restart(capstan_adaptive_state* state, const float* values) {
  static const float reach[][2] = {{(-1.2f), 1.2f}};
  float angles[1];
  int i, known = 1;
  for (i = 0; i < 1; ++i) {
    const float angle = state->carry[i];
    known &= angle >= -50.0f && angle <= 50.0f;
    angles[i] = angle < reach[i][0] ? reach[i][0] : angle > reach[i][1] ? reach[i][1] : angle;
  }
  known &= state->samples > 0;
  capstan_adaptive_begin(state, values);
  for (i = 0; i < 1; ++i) {
    float* variance = &state->carry[8 + i * (8 + 1)];
    if (known) state->carry[i] = angles[i];
    if (*variance < 0.25f) *variance = 0.25f;
  }
}

int capstan_adaptive_step(capstan_adaptive_state* state, float dt, const float* values, capstan_adaptive_output* out) {
  float x[1 + 2 * 2], y[2];
  long parts, k;
  int i, wild = 0;
  if (!(dt >= 1e-09f) && !(dt == 0.0f && state->samples == 0)) return CAPSTAN_ADAPTIVE_LATE;
  if (!(dt <= 100000 * 0.00625f)) return CAPSTAN_ADAPTIVE_GAP;
  for (i = 0; i < 2; ++i) wild |= values[i] > 10000000.0f || values[i] < -10000000.0f;
  if (wild) return CAPSTAN_ADAPTIVE_BAD;
  /* a long interval is bridged by several predictions, so that sub-steps stay short */
  parts = (long)(dt / (0.00625f));
  if ((float)parts < dt / (0.00625f) - 1e-05f) parts += 1;
  if (parts < 1) parts = 1;
  x[0] = dt / (float)parts;
  for (k = parts; k > 0; --k) {
    for (i = 0; i < 2; ++i) {
      const int last = k == 1, led = i < 1;
      const int there = is_there(values[i]);
      /* displacements cross a gap in a straight line to the reading that ends it */
      x[1 + i] = there && (last || led) ? values[i] : 0.0f;
      x[1 + 2 + i] = !there ? 0.0f : last ? 1.0f : led ? -(float)k : 0.0f;
    }
    adaptive(state->carry, x, numbers, y);
  }
  if (state->samples < 2) state->samples += 1;
  if (out) {
    out->angle = state->carry[0];
    out->angle_std = root(state->carry[8]);
    for (i = 0; i < 1; ++i) {
      out->innovations[i] = is_there(values[measured[i]]) ? y[i] : NAN;
      out->innovation_variances[i] = y[1 + i];
    }
  }
  for (i = 0; i < 8; ++i) {
    /* neither infinite nor undefined, and no negative variance */
    if (!(state->carry[i] - state->carry[i] == 0.0f)) return CAPSTAN_ADAPTIVE_LOST;
    if (!(state->carry[8 + i * (8 + 1)] >= 0.0f)) return CAPSTAN_ADAPTIVE_LOST;
  }
  for (i = 0; i < 1; ++i)
    if (!(state->carry[i] >= -50.0f && state->carry[i] <= 50.0f)) return CAPSTAN_ADAPTIVE_LOST;
  return CAPSTAN_ADAPTIVE_OK;
}

/* when a sensor is missing and dead [s], whether it has noise; where a drive can be; numbers of the rig and 3 stds */
static const float overdue[] = {0.0125f, 0.0125f};
static const float dead[] = {0.5f, 0.5f};
static const float low[] = {(-40.3234907f)};
static const float high[] = {40.3234907f};
static const float prior_mean[] = {0.150221892f, 0.0200092576f, 0.0503527565f, 20.0f, 20.0f, 1.0f};
static const float allowed[] = {0.148996653f, 0.0179536306f, 0.0586527036f, 12.0f, 12.0f, 0.45f};
static const unsigned char noisy[] = {1, 1};
static const unsigned char placed[] = {0};
static const unsigned char lasting[] = {2, 3, 4, 5, 6, 7};

static int worse(int health, int than) { return than > health ? than : health; }

void capstan_adaptive_watch_begin(capstan_adaptive_watch* watch) {
  int i;
  memset(watch, 0, sizeof *watch);
  watch->pace = 1.0f;
  for (i = 0; i < CAPSTAN_ADAPTIVE_CHANNELS; ++i) watch->last[i] = NAN;
  for (i = 0; i < CAPSTAN_ADAPTIVE_MEASURED; ++i) watch->ratio[i] = 1.0f;
}

int capstan_adaptive_health(capstan_adaptive_watch* watch, const capstan_adaptive_state* state, float dt, const float* values,
                  const capstan_adaptive_output* out) {
  const float stds[] = {out->angle_std};
  const int first = !watch->begun;
  /* the share that this sample has in means over a second */
  const float since = dt > 0.0f && dt < 0.5f ? dt : 0.005f;
  const float share = since < 1.0f ? since / 1.0f : 1.0f;
  int i, health = CAPSTAN_ADAPTIVE_HEALTH_OK, any = 0, tested = 0;
  watch->begun = 1;
  if (!first) {
    const float pace = dt / 0.005f, weight = 0.005f < 1.0f ? 0.005f / 1.0f : 1.0f;
    if (dt > 0.0075f) health = CAPSTAN_ADAPTIVE_HEALTH_GAP;
    watch->pace += weight * ((pace < 2.0f ? pace : 2.0f) - watch->pace);
    if (watch->pace < 0.2f) health = CAPSTAN_ADAPTIVE_HEALTH_DISAGREES; /* unit of time? */
  }
  for (i = 0; i < CAPSTAN_ADAPTIVE_CHANNELS; ++i) {
    const int there = is_there(values[i]), moved = there && values[i] != watch->last[i];
    any |= there;
    /* one that has not been there at all is missing from the beginning */
    watch->age[i] = there ? 0.0f : first ? 1.01f * overdue[i] : watch->age[i] + dt;
    watch->same[i] = first || moved ? 0.0f : watch->same[i] + dt;
    if (there) watch->last[i] = values[i];
    if (watch->age[i] >= dead[i] || (noisy[i] && there && watch->same[i] >= dead[i]))
      health = worse(health, CAPSTAN_ADAPTIVE_HEALTH_DEAD);
    else if (watch->age[i] > overdue[i])
      health = worse(health, CAPSTAN_ADAPTIVE_HEALTH_MISSING);
  }
  if (!any) health = worse(health, CAPSTAN_ADAPTIVE_HEALTH_MISSING);
  for (i = 0; i < 1; ++i) { /* a drive beyond where it can be, for most of a second or by far */
    const float value = values[placed[i]], reach = high[i] - low[i];
    const int there = is_there(value), beyond = there && (value < low[i] || value > high[i]);
    watch->outside[i] += share * ((float)beyond - watch->outside[i]);
    if (watch->outside[i] > 0.5f || (there && fabsf(value - 0.5f * (low[i] + high[i])) > 10.0f * reach))
      health = worse(health, CAPSTAN_ADAPTIVE_HEALTH_DISAGREES);
  }
  for (i = 0; i < CAPSTAN_ADAPTIVE_MEASURED; ++i) {
    const float innovation = out->innovations[i];
    if (is_there(innovation)) {
      const float ratio = innovation * innovation / out->innovation_variances[i];
      watch->ratio[i] += share * ((ratio < 25.0f ? ratio : 25.0f) - watch->ratio[i]);
    }
    tested |= watch->ratio[i] >= 0.05f;
    if (watch->ratio[i] > 2.5f) health = worse(health, CAPSTAN_ADAPTIVE_HEALTH_DISAGREES);
  }
  if (!tested) health = worse(health, CAPSTAN_ADAPTIVE_HEALTH_UNTESTED);
  for (i = 0; i < 6; ++i) { /* a number of the rig that left its prior */
    const int k = lasting[i];
    if (fabsf(state->carry[k] - prior_mean[i]) - root(state->carry[8 + k * (8 + 1)]) > allowed[i])
      health = worse(health, CAPSTAN_ADAPTIVE_HEALTH_DISAGREES);
  }
  for (i = 0; i < (int)(sizeof stds / sizeof *stds); ++i)
    if (stds[i] > 1.0f && !first) health = worse(health, CAPSTAN_ADAPTIVE_HEALTH_DISAGREES);
  return health;
}
